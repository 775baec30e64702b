// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/jpeg.h"
#include "server/delivery/gateway.h"
#include "server/delivery/mesh_view.h"
#include "server/pipeline/frame.h"
#include "server/pipeline/stage_times.h"
#include "server/pipeline/studio.h"
#include "server/segmentation/actor_mesh.h"

namespace mixstage {

// What the meshes of a frame are made of: nothing in it changes any more.
struct MeshJob {
  struct Object {
    std::uint32_t id = 0;
    std::shared_ptr<const Mesh> mesh;
  };
  std::shared_ptr<const Frame> frame{};
  cv::Mat1f actor_depth_m{};  // a copy: the frame's belongs to a worker
  RigidTransform T_scene_color = RigidTransform::Identity();
  std::shared_ptr<const BackgroundModel> room{};  // null: not known yet, or the camera moves
  std::vector<Object> objects{};
};
// On the thread that ran the studio's stages, before their next frame.
[[nodiscard]] MeshJob MakeMeshJob(const Studio& studio, std::shared_ptr<const Frame> frame);

[[nodiscard]] inline MeshView ViewOf(const PictureMesh& mesh) {
  return {.positions = mesh.positions, .uvs = mesh.uvs, .indices = mesh.indices};
}

// Meshes for viewers who look from elsewhere: the actor's of every job; the room's and the objects' when they
// are new, changed or gone. Owned by the `mesh` thread.
class MeshBroadcast {
 public:
  static Result<MeshBroadcast> Create(const PinholeCamera& color, Gateway& gateway);

  // Fails when an encoder refuses something; what else there was has gone out. A mesh that is too large for a
  // message is left out with a warning, once.
  Status Send(const MeshJob& job, StageTimes& times);

 private:
  MeshBroadcast(const PinholeCamera& color, ActorMesher mesher, Gateway& gateway)
      : color_(color), mesher_(std::move(mesher)), gateway_(&gateway) {}
  Status SendActor(const MeshJob& job, StageTimes& times);
  Status SendRoom(const MeshJob& job);
  Status SendObjects(const MeshJob& job);
  void Publish(const MeshJob& job, WatchMesh mesh);

  PinholeCamera color_;
  ActorMesher mesher_;
  JpegEncoder jpeg_;
  std::vector<std::uint8_t> texture_;
  Gateway* gateway_;
  // What viewers have been told.
  std::shared_ptr<const BackgroundModel> room_;
  std::map<std::uint32_t, std::shared_ptr<const Mesh>> objects_;
};

}  // namespace mixstage
