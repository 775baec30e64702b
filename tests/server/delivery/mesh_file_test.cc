// SPDX-License-Identifier: Apache-2.0
//
// What the writers write our own importers must read, which trust nobody.
#include "server/delivery/mesh_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "proto/codec/jpeg.h"
#include "server/scene/model_file.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

const std::vector<Eigen::Vector3f> kPositions = {{0, 0, 1}, {2, 0, 1}, {2, 3, 1.5f}, {0, 3, 1}};
const std::vector<Eigen::Vector2f> kUvs = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
const std::vector<std::uint32_t> kIndices = {0, 1, 2, 0, 2, 3};
const std::vector<std::array<std::uint8_t, 3>> kColors = {
    {255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {9, 99, 199}};

class MeshFileTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("mixstage_mesh_file_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  Result<LoadedModel> Import(const char* name, const std::vector<std::uint8_t>& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    return LoadModel(folder_ / name);
  }
  fs::path folder_;
};

TEST_F(MeshFileTest, GlbIsImportedYUpWithItsTexture) {
  YuvImage picture = FromBgr(cv::Mat3b(16, 24, cv::Vec3b(20, 120, 220)), ChromaLayout::k420);
  std::vector<std::uint8_t> jpeg;
  ASSERT_TRUE(JpegEncoder().Encode(picture, 90, jpeg));
  const auto model =
      Import("a.glb", WriteGlb({.positions = kPositions, .uvs = kUvs, .indices = kIndices}, jpeg));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ(model->up, UpAxis::kY);
  ASSERT_EQ(model->mesh.indices.size(), 6u);
  for (std::size_t i = 0; i < 6; ++i) {
    const Eigen::Vector3f& world = kPositions[kIndices[i]];
    const Eigen::Vector3f& y_up = model->mesh.positions[model->mesh.indices[i]];
    EXPECT_LT((y_up - Eigen::Vector3f(world.x(), world.z(), -world.y())).norm(), 1e-5f) << i;
    EXPECT_LT((model->mesh.uvs[model->mesh.indices[i]] - kUvs[kIndices[i]]).norm(), 1e-6f) << i;
  }
  ASSERT_EQ(model->mesh.textures.size(), 1u);
  EXPECT_EQ(model->mesh.textures[0].rgba.size(), cv::Size(24, 16));
  EXPECT_NEAR(model->mesh.textures[0].rgba(8, 8)[0], 220, 4);
  EXPECT_TRUE(model->mesh.materials.at(0).double_sided);
}

TEST_F(MeshFileTest, GlbWithoutTexture) {
  const auto model = Import("b.glb", WriteGlb({.positions = kPositions, .indices = kIndices}, {}));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ(model->mesh.triangle_count(), 2u);
  EXPECT_TRUE(model->mesh.textures.empty());
}

TEST_F(MeshFileTest, PlyIsImportedAsItIs) {
  const auto model =
      Import("c.ply", WritePly({.positions = kPositions, .colors = kColors, .indices = kIndices}));
  ASSERT_TRUE(model) << model.error().message;
  ASSERT_EQ(model->mesh.indices.size(), 6u);
  ASSERT_FALSE(model->mesh.colors.empty());
  for (std::size_t i = 0; i < 6; ++i) {
    const std::uint32_t v = model->mesh.indices[i];
    EXPECT_EQ(model->mesh.positions[v], kPositions[kIndices[i]]);
    EXPECT_NEAR(model->mesh.colors[v].x(), kColors[kIndices[i]][0] == 255 ? 1 : 0, 0.01);  // linear light
  }
}

}  // namespace
}  // namespace mixstage
