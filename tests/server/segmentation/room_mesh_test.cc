// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/room_mesh.h"

#include <gtest/gtest.h>

#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

PinholeCamera Lens() {
  PinholeCamera camera;
  camera.width = 512, camera.height = 384;
  camera.fx = camera.fy = 500, camera.cx = 255.5, camera.cy = 191.5;
  camera.k1 = -0.1;
  return camera;
}

// A model whose depth is the test's.
BackgroundModel Room(const cv::Mat1f& quarter_depth_m) {
  BackgroundModel room;
  room.width = 512, room.height = 384;
  for (cv::Mat1f& mean : room.mean) mean = cv::Mat1f(192, 256, 100.0f);
  room.room_depth_m = quarter_depth_m;
  room.sigma_m = cv::Mat1f(quarter_depth_m.size(), 0.01f);
  return room;
}

TEST(RoomMesh, AWallIsOneSurfaceThroughTheRealLens) {
  const PinholeCamera lens = Lens();
  RigidTransform T_scene_color = RigidTransform::Identity();
  T_scene_color.translation() << 0, 0, 1.5;
  const PictureMesh mesh = MakeRoomMesh(Room(cv::Mat1f(96, 128, 4.0f)), lens, T_scene_color, {});
  EXPECT_EQ(mesh.indices.size(), 2u * 3 * 127 * 95);
  ASSERT_EQ(mesh.uvs.size(), mesh.positions.size());
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const Eigen::Vector3d p_color = T_scene_color.inverse() * mesh.positions[i].cast<double>();
    ASSERT_NEAR(p_color.z(), 4, 1e-5);
    const auto pixel = lens.Project(p_color);
    ASSERT_TRUE(pixel);
    ASSERT_NEAR(pixel->x(), static_cast<double>(mesh.uvs[i].x()) * 512 - 0.5, 1e-3);
    ASSERT_NEAR(pixel->y(), static_cast<double>(mesh.uvs[i].y()) * 384 - 0.5, 1e-3);
  }
  for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
    const Eigen::Vector3f &a = mesh.positions[mesh.indices[t]], &b = mesh.positions[mesh.indices[t + 1]],
                          &c = mesh.positions[mesh.indices[t + 2]];
    ASSERT_LT((b - a).cross(c - a).z(), 0) << "faces the camera";
  }
}

TEST(RoomMesh, IsTornAtAStepAndNotOnASlope) {
  // Left a cupboard 30 cm before the wall; below, a floor seen at a flat angle: z = 1.5 m / slope.
  cv::Mat1f depth_m(96, 128, 4.0f);
  depth_m(cv::Rect(0, 0, 40, 60)).setTo(3.7f);
  for (int y = 60; y < 96; ++y) depth_m.row(y).setTo(4.0f * 36 / static_cast<float>(y - 60 + 36));
  const PictureMesh mesh = MakeRoomMesh(Room(depth_m), Lens(), RigidTransform::Identity(), {});
  std::size_t floor = 0;
  for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
    float nearest = 10, farthest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      nearest = std::min(nearest, mesh.positions[mesh.indices[t + k]].z());
      farthest = std::max(farthest, mesh.positions[mesh.indices[t + k]].z());
    }
    ASSERT_LT(farthest - nearest, 0.25f);
    floor += nearest < 3.6f ? 1 : 0;
  }
  EXPECT_GT(floor, 2u * 127 * 29) << "the floor is whole";
}

TEST(RoomMesh, AHoleStaysAHoleAndTheBoundIsKept) {
  cv::Mat1f depth_m(96, 128, 4.0f);
  depth_m(cv::Rect(50, 30, 20, 20)).setTo(0);
  for (const std::size_t max_triangles : {std::size_t{60'000}, std::size_t{6000}, std::size_t{100}}) {
    const PictureMesh mesh =
        MakeRoomMesh(Room(depth_m), Lens(), RigidTransform::Identity(), {.max_triangles = max_triangles});
    EXPECT_LE(mesh.indices.size() / 3, max_triangles);
    EXPECT_GT(mesh.indices.size() / 3, max_triangles / 6);
    for (const Eigen::Vector3f& p : mesh.positions) ASSERT_GT(p.z(), 3.9f);
  }
}

TEST(RoomMesh, WhatIsLearntByColourAloneHasNone) {
  BackgroundModel room = Room(cv::Mat1f());
  EXPECT_TRUE(MakeRoomMesh(room, Lens(), RigidTransform::Identity(), {}).empty());
}

TEST(RoomMesh, OfALearntRoomIsWhole) {
  FlatRoom flat(512, 384, 3.0f);
  const BackgroundModel room = flat.Learn(20);
  const PictureMesh mesh = MakeRoomMesh(room, Lens(), RigidTransform::Identity(), {});
  EXPECT_GT(mesh.indices.size() / 3, 24'000u);
  const YuvImage picture = RoomPicture(room);
  EXPECT_EQ(picture.width(), 256);
  EXPECT_NEAR(YcbcrToRgb(picture.y(100, 100), picture.cb(50, 50), picture.cr(50, 50)).r, 120, 15);
}

}  // namespace
}  // namespace mixstage
