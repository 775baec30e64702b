// SPDX-License-Identifier: Apache-2.0
#include "server/scene/vertex_colors.h"

#include <gtest/gtest.h>

namespace mixstage {
namespace {

using Color = std::array<std::uint8_t, 3>;

Mesh Triangle() {
  Mesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.normals.assign(3, Eigen::Vector3f::UnitZ());
  mesh.indices = {0, 1, 2};
  mesh.materials.resize(1);
  mesh.parts = {{0, 3, 0}};
  return mesh;
}

// Red, green; blue, white.
Texture FourTexels(TextureWrap wrap) {
  Texture texture;
  texture.rgba = cv::Mat4b(2, 2);
  texture.rgba(0, 0) = {255, 0, 0, 255};
  texture.rgba(0, 1) = {0, 255, 0, 255};
  texture.rgba(1, 0) = {0, 0, 255, 255};
  texture.rgba(1, 1) = {255, 255, 255, 255};
  texture.wrap_u = texture.wrap_v = wrap;
  return texture;
}

TEST(VertexColors, BaseColourAndVertexColourMultiplyInLinearLight) {
  Mesh mesh = Triangle();
  mesh.materials[0].base_color = {0.5f, 1, 0};
  mesh.colors = {{1, 1, 1}, {0.5f, 0.25f, 1}, {0, 0, 0}};
  const auto colors = BakeVertexColors(mesh);
  EXPECT_EQ(colors[0], (Color{188, 255, 0}));  // linear 0.5 is sRGB 188
  EXPECT_EQ(colors[1], (Color{137, 137, 0}));  // linear 0.25
  EXPECT_EQ(colors[2], (Color{0, 0, 0}));
}

TEST(VertexColors, TheTextureIsReadAtTheVertexVDown) {
  Mesh mesh = Triangle();
  mesh.textures = {FourTexels(TextureWrap::kClamp)};
  mesh.materials[0].texture = 0;
  mesh.uvs = {{0.25f, 0.25f}, {0.75f, 0.25f}, {0.25f, 0.75f}};
  auto colors = BakeVertexColors(mesh);
  EXPECT_EQ(colors[0], (Color{255, 0, 0}));
  EXPECT_EQ(colors[1], (Color{0, 255, 0}));
  EXPECT_EQ(colors[2], (Color{0, 0, 255}));
  mesh.uvs[0] = {0.5f, 0.5f};  // between all four: 2 of 4 in every colour
  EXPECT_EQ(BakeVertexColors(mesh)[0], (Color{188, 188, 188}));
}

TEST(VertexColors, BesideThePictureItIsWrappedAsTheFileSays) {
  for (const auto& [wrap, expected] : {std::pair{TextureWrap::kRepeat, Color{255, 0, 0}},
                                       {TextureWrap::kClamp, Color{0, 255, 0}},
                                       {TextureWrap::kMirror, Color{0, 255, 0}}}) {
    Mesh mesh = Triangle();
    mesh.textures = {FourTexels(wrap)};
    mesh.materials[0].texture = 0;
    mesh.uvs = {{1.25f, 0.25f}, {1e30f, -1e30f}, {-3.75f, 4.25f}};
    EXPECT_EQ(BakeVertexColors(mesh)[0], expected) << static_cast<int>(wrap);
  }
}

TEST(VertexColors, AVertexThatNoPartUsesIsWhite) {
  Mesh mesh = Triangle();
  mesh.materials[0].base_color.setZero();
  mesh.positions.emplace_back(5, 5, 5);
  mesh.normals.push_back(Eigen::Vector3f::UnitZ());
  EXPECT_EQ(BakeVertexColors(mesh)[3], (Color{255, 255, 255}));
}

}  // namespace
}  // namespace mixstage
