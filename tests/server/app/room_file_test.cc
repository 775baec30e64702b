// SPDX-License-Identifier: Apache-2.0
#include "server/app/room_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgproc.hpp>

namespace mixstage {
namespace {

namespace fs = std::filesystem;

// Two triangles that share an edge, a texture of the size that scans have.
RoomModel Wall() {
  RoomModel room;
  room.positions = {{1, 2, 3}, {1, 4, 3}, {1, 4, 5}, {1, 2, 5}};
  room.uvs = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  room.indices = {0, 1, 2, 0, 2, 3};
  room.texture_bgr = cv::Mat3b(3072, 4096, cv::Vec3b(40, 90, 200));
  cv::circle(room.texture_bgr, {1000, 800}, 300, {200, 200, 20}, cv::FILLED);
  return room;
}

TEST(RoomFile, KeepsSurfaceAndPicture) {
  const fs::path folder = fs::path(testing::TempDir()) / "room_file";
  fs::create_directories(folder);
  const RoomModel in = Wall();
  ASSERT_TRUE(WriteRoom(folder, in));
  const auto out = ReadRoom(folder);
  ASSERT_TRUE(out) << out.error().message;
  ASSERT_EQ(out->positions.size(), 4u);
  ASSERT_EQ(out->triangle_count(), 2u);
  for (std::size_t i = 0; i < in.indices.size(); ++i) {
    EXPECT_TRUE(out->positions[out->indices[i]].isApprox(in.positions[in.indices[i]], 1e-6f));
    EXPECT_EQ(out->uvs[out->indices[i]], in.uvs[in.indices[i]]);
  }
  ASSERT_EQ(out->texture_bgr.size(), in.texture_bgr.size());
  EXPECT_LT(cv::norm(out->texture_bgr, in.texture_bgr, cv::NORM_L1) /
                static_cast<double>(3 * in.texture_bgr.total()),
            1.0);

  std::ofstream(folder / "room.glb") << "glTF, or not";
  const auto broken = ReadRoom(folder);
  ASSERT_FALSE(broken);
  EXPECT_EQ(broken.error().code, ErrorCode::kBadInput);
  EXPECT_NE(broken.error().message.find("room.glb"), std::string::npos);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace mixstage
