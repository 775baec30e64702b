// SPDX-License-Identifier: Apache-2.0
//
// From the synthetic set to a viewer: what arrives is held against the set's exact truth.
#include "server/pipeline/mesh_broadcast.h"

#include <draco/compression/decode.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/scene/scene_file.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

std::shared_ptr<const CapturedFrame> Capture(SyntheticScene& scene, double t_s) {
  auto frame = std::make_shared<CapturedFrame>();
  frame->capture_us = std::llround(t_s * 1e6);
  frame->frame = std::llround(t_s * 30);
  scene.RenderColor(t_s, frame->color);
  auto depth = std::make_shared<DepthPicture>();
  depth->capture_us = frame->capture_us;
  depth->sequence = frame->frame;
  scene.RenderTof(t_s, depth->counts, depth->amplitude);
  frame->depth = depth;
  return frame;
}

struct Decoded {
  std::vector<Eigen::Vector3d> positions;
  std::size_t triangles = 0;
  bool has_uvs = false, has_normals = false, has_colors = false;
};

Decoded Decode(std::span<const std::uint8_t> bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto result = decoder.DecodeMeshFromBuffer(&buffer);
  EXPECT_TRUE(result.ok()) << result.status().error_msg_string();
  if (!result.ok()) return {};
  const std::unique_ptr<draco::Mesh> mesh = std::move(result).value();
  Decoded decoded;
  decoded.triangles = mesh->num_faces();
  const draco::PointAttribute* position = mesh->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  for (std::uint32_t i = 0; i < mesh->num_points(); ++i) {
    Eigen::Vector3f p;
    position->ConvertValue<float, 3>(position->mapped_index(draco::PointIndex(i)), p.data());
    decoded.positions.push_back(p.cast<double>());
  }
  decoded.has_uvs = mesh->GetNamedAttribute(draco::GeometryAttribute::TEX_COORD) != nullptr;
  decoded.has_normals = mesh->GetNamedAttribute(draco::GeometryAttribute::NORMAL) != nullptr;
  decoded.has_colors = mesh->GetNamedAttribute(draco::GeometryAttribute::COLOR) != nullptr;
  return decoded;
}

// Differences in depth to what stands there in truth, metres, rising.
std::vector<double> Errors(const SyntheticScene& scene, const Decoded& mesh, double t_s, bool figure) {
  const RigidTransform T_color_world = scene.TruthPose().inverse();
  std::vector<double> errors;
  for (std::size_t i = 0; i < mesh.positions.size(); i += 5) {  // the truth is traced, ray by ray
    const Eigen::Vector3d p_color = T_color_world * mesh.positions[i];
    const auto pixel = scene.rig().color.Project(p_color);
    if (!pixel) continue;
    const auto truth = scene.TruthAt(SyntheticCamera::kColor, pixel->x(), pixel->y(), t_s);
    if (truth && truth->figure == figure) errors.push_back(std::abs(p_color.z() - truth->depth_m));
  }
  EXPECT_GT(errors.size(), 0.8 * static_cast<double>(mesh.positions.size()) / 5);
  std::sort(errors.begin(), errors.end());
  return errors;
}

WatchMesh Read(const Received& received) {
  const auto mesh =
      ReadWatchMesh({reinterpret_cast<const std::uint8_t*>(received.bytes.data()), received.bytes.size()});
  EXPECT_TRUE(mesh);
  return mesh ? *mesh : WatchMesh{};
}

TEST(MeshBroadcast, TheViewersActorAndRoomStandWhereTheyTrulyAre) {
  auto synthetic = SyntheticScene::Create(SyntheticRig(), {}).value();
  StudioSetup setup;
  setup.rig = SyntheticRig();
  setup.scene =
      LoadScene(std::string(MIXSTAGE_SOURCE_DIR) + "/deploy/demo/scene.yaml", LoadModel).value().scene;
  auto studio = Studio::Create(std::move(setup)).value();
  StageTimes times(0);
  for (int i = 0; i < 40 && studio.room_state() != RoomState::kKnown; ++i) {
    Frame empty;
    empty.captured = Capture(synthetic, 0.3 + i / 30.0);
    studio.Run(empty, times);
  }
  ASSERT_EQ(studio.room_state(), RoomState::kKnown);

  Gateway gateway(GatewayConfig{.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  ASSERT_TRUE(viewer.SendText(R"({"type":"subscribe","streams":["mesh"]})"));
  ASSERT_TRUE(Eventually([&] { return gateway.WantsStream(WatchStream::kActorMesh); }));
  auto broadcast = MeshBroadcast::Create(studio.rig().color, gateway).value();
  constexpr double kTime_s = 14.0;
  auto frame = std::make_shared<Frame>();
  frame->captured = Capture(synthetic, kTime_s);
  studio.Run(*frame, times);
  ASSERT_TRUE(broadcast.Send(MakeMeshJob(studio, frame), times));

  std::map<std::pair<WatchStream, std::uint32_t>, Received> got;
  while (got.size() < 2 + studio.scene()->objects.size()) {
    const auto received = viewer.ReadBinary();
    ASSERT_TRUE(received);
    const WatchMesh mesh = Read(*received);
    ASSERT_TRUE(got.emplace(std::pair{mesh.stream, mesh.id}, *received).second) << "each once";
  }
  const auto message = [&](WatchStream stream, std::uint32_t id) { return Read(got.at({stream, id})); };

  const WatchMesh actor = message(WatchStream::kActorMesh, 0);
  EXPECT_EQ(actor.frame, 420u);
  EXPECT_EQ(actor.capture_us, 14'000'000);
  for (int i = 0; i < 12; ++i) {
    EXPECT_NEAR(actor.T_scene_color[static_cast<std::size_t>(i)],
                synthetic.TruthPose().matrix()(i / 4, i % 4), 1e-3);
  }
  const Decoded actor_mesh = Decode(actor.mesh);
  EXPECT_GT(actor_mesh.positions.size(), 3000u);
  EXPECT_LE(actor_mesh.positions.size(), 17'000u);
  EXPECT_TRUE(actor_mesh.has_uvs);
  const std::vector<double> actor_errors_m = Errors(synthetic, actor_mesh, kTime_s, true);
  EXPECT_LT(actor_errors_m.at(actor_errors_m.size() / 2), 0.015);
  EXPECT_LT(actor_errors_m.at(actor_errors_m.size() * 9 / 10), 0.06);
  EXPECT_LT(actor.mesh.size(), 35'000u);
  YuvImage texture;
  ASSERT_TRUE(JpegDecoder().Decode(actor.texture, texture));
  EXPECT_GT(texture.height(), texture.width()) << "he stands";

  const WatchMesh room = message(WatchStream::kRoomMesh, 0);
  EXPECT_EQ(room.T_scene_color, kIdentityPose);
  const Decoded room_mesh = Decode(room.mesh);
  EXPECT_LE(room_mesh.triangles, 60'000u);
  EXPECT_GT(room_mesh.triangles, 15'000u);
  const std::vector<double> room_errors_m = Errors(synthetic, room_mesh, 0.3, false);
  EXPECT_LT(room_errors_m.at(room_errors_m.size() / 2), 0.01);
  EXPECT_LT(room_errors_m.at(room_errors_m.size() * 9 / 10), 0.05);
  ASSERT_TRUE(JpegDecoder().Decode(room.texture, texture));
  EXPECT_EQ(texture.width(), 512);

  for (const SceneObject& object : studio.scene()->objects) {
    const Decoded mesh = Decode(message(WatchStream::kObjectMesh, object.id).mesh);
    EXPECT_LE(mesh.triangles, object.mesh->triangle_count());
    EXPECT_GT(mesh.triangles, object.mesh->triangle_count() * 9 / 10);
    EXPECT_TRUE(mesh.has_normals && mesh.has_colors);
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& p : mesh.positions) box.extend(p);
    const Eigen::AlignedBox3f file = object.mesh->Bounds();
    EXPECT_LT((box.min() - file.min().cast<double>()).norm(), 1e-3);
    EXPECT_LT((box.max() - file.max().cast<double>()).norm(), 1e-3);
  }

  // Without the actor the message has no mesh; what stands is not sent again.
  auto empty = std::make_shared<Frame>();
  empty->captured = Capture(synthetic, 2.0);
  studio.Run(*empty, times);
  empty->alpha.setTo(0);
  ASSERT_TRUE(broadcast.Send(MakeMeshJob(studio, empty), times));
  const auto last = viewer.ReadBinary();
  ASSERT_TRUE(last);
  EXPECT_EQ(Read(*last).stream, WatchStream::kActorMesh);
  EXPECT_TRUE(Read(*last).mesh.empty());
  EXPECT_EQ(gateway.counters().meshes_sent, 3 + studio.scene()->objects.size());
}

}  // namespace
}  // namespace mixstage
