// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/mesh_broadcast.h"

#include <algorithm>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "server/delivery/draco_mesh.h"
#include "server/scene/vertex_colors.h"
#include "server/segmentation/room_mesh.h"

namespace mixstage {
namespace {

constexpr int kActorQuality = 75, kRoomQuality = 85;  // of JPEG
constexpr DracoPrecision kActorPrecision = {};
constexpr DracoPrecision kStandingPrecision = {.position_bits = 13, .uv_bits = 12};  // a room is large
constexpr std::size_t kMaxObjectTriangles = 1'000'000;  // half a second of encoding

WatchPose PoseRows(const RigidTransform& T) {
  WatchPose rows{};
  for (int i = 0; i < 12; ++i)
    rows[static_cast<std::size_t>(i)] = static_cast<float>(T.matrix()(i / 4, i % 4));
  return rows;
}

}  // namespace

MeshJob MakeMeshJob(const Studio& studio, std::shared_ptr<const Frame> frame) {
  MeshJob job{.actor_depth_m = frame->actor_depth_m.clone(),
              .T_scene_color = studio.TSceneColor(*frame),
              .room = studio.standing_room()};
  if (const auto& scene = studio.scene()) {
    for (const SceneObject& object : scene->objects) job.objects.push_back({object.id, object.mesh});
  }
  job.frame = std::move(frame);
  return job;
}

Result<MeshBroadcast> MeshBroadcast::Create(const PinholeCamera& color, Gateway& gateway) {
  auto mesher = ActorMesher::Create({}, color);
  if (!mesher) return tl::unexpected(mesher.error());
  return MeshBroadcast(color, std::move(*mesher), gateway);
}

Status MeshBroadcast::Send(const MeshJob& job, StageTimes& times) {
  Status status = SendActor(job, times);
  for (const Status& other : {SendRoom(job), SendObjects(job)}) {
    if (status && !other) status = other;
  }
  return status;
}

Status MeshBroadcast::SendActor(const MeshJob& job, StageTimes& times) {
  WatchMesh message{.stream = WatchStream::kActorMesh, .T_scene_color = PoseRows(job.T_scene_color)};
  const PictureMesh* mesh = nullptr;
  {
    const StageTimer timer(times, "actor_mesh");
    mesh = &mesher_.Run(View(job.frame->alpha), View(job.actor_depth_m), job.T_scene_color);
  }
  if (mesh->empty()) {
    Publish(job, message);
    return {};
  }
  const StageTimer timer(times, "encode_mesh");
  auto draco = EncodeDraco(ViewOf(*mesh), kActorPrecision);
  if (!draco) return Within("actor mesh", draco.error());
  if (auto ok = jpeg_.Encode(Crop(job.frame->Real(), mesh->crop), kActorQuality, texture_); !ok) {
    return Within("actor mesh", ok.error());
  }
  message.mesh = *draco;
  message.texture = texture_;
  Publish(job, message);
  return {};
}

Status MeshBroadcast::SendRoom(const MeshJob& job) {
  if (job.room == nullptr || job.room == room_) return {};
  room_ = job.room;
  const PictureMesh mesh = MakeRoomMesh(*room_, color_, job.T_scene_color, {});
  if (mesh.empty()) {  // known by colour alone
    gateway_->RemoveMesh(WatchStream::kRoomMesh, 0);
    return {};
  }
  auto draco = EncodeDraco(ViewOf(mesh), kStandingPrecision);
  if (!draco) return Within("room mesh", draco.error());
  std::vector<std::uint8_t> texture;
  if (auto ok = jpeg_.Encode(RoomPicture(*room_), kRoomQuality, texture); !ok)
    return Within("room mesh", ok.error());
  Publish(job, {.stream = WatchStream::kRoomMesh, .mesh = *draco, .texture = texture});
  return {};
}

Status MeshBroadcast::SendObjects(const MeshJob& job) {
  Status status;
  std::map<std::uint32_t, std::shared_ptr<const Mesh>> gone = std::move(objects_);
  objects_.clear();
  std::map<const Mesh*, std::vector<std::uint8_t>> encoded;  // objects of one file share it
  for (const MeshJob::Object& object : job.objects) {
    const auto known = gone.find(object.id);
    const bool same = known != gone.end() && known->second == object.mesh;
    objects_[object.id] = object.mesh;
    if (same) gone.erase(known);
    if (same || object.mesh->triangle_count() > kMaxObjectTriangles) {
      if (!same)
        spdlog::warn("mesh object={} triangles={} too many to be sent", object.id,
                     object.mesh->triangle_count());
      continue;
    }
    auto found = encoded.find(object.mesh.get());
    if (found == encoded.end()) {
      const auto colors = BakeVertexColors(*object.mesh);
      auto draco = EncodeDraco({.positions = object.mesh->positions,
                                .normals = object.mesh->normals,
                                .colors = colors,
                                .indices = object.mesh->indices},
                               kStandingPrecision);
      if (!draco) {
        status = Within("mesh of object " + std::to_string(object.id), draco.error());
        continue;
      }
      found = encoded.emplace(object.mesh.get(), std::move(*draco)).first;
    }
    if (known != gone.end()) gone.erase(known);  // replaced by what is sent now
    Publish(job, {.stream = WatchStream::kObjectMesh, .id = object.id, .mesh = found->second});
  }
  for (const auto& [id, mesh] : gone) gateway_->RemoveMesh(WatchStream::kObjectMesh, id);
  return status;
}

void MeshBroadcast::Publish(const MeshJob& job, WatchMesh mesh) {
  if (mesh.mesh.size() + mesh.texture.size() > kMaxMeshBytes) {
    spdlog::warn("mesh stream={} id={} bytes={} too many to be sent", static_cast<int>(mesh.stream), mesh.id,
                 mesh.mesh.size() + mesh.texture.size());
    return;
  }
  mesh.frame = static_cast<std::uint64_t>(job.frame->captured->frame);
  mesh.capture_us = job.frame->captured->capture_us;
  mesh.encoded_us = MonotonicMicros();
  gateway_->PublishWhole(MakeMeshMessage(mesh));
}

}  // namespace mixstage
