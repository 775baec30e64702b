// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/draco_mesh.h"

#include <draco/compression/decode.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mixstage {
namespace {

// A body-like sheet of columns x rows vertices: 0.6 x 1.8 m, bulging by 15 cm, with a ToF camera's noise.
struct Sheet {
  Sheet(int columns, int rows) {
    std::mt19937 random(3);
    std::normal_distribution<float> noise(0, 0.002f);
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        const float u = static_cast<float>(x) / static_cast<float>(columns - 1);
        const float v = static_cast<float>(y) / static_cast<float>(rows - 1);
        positions.emplace_back(0.6f * u, 1.8f * v, 3 - 0.15f * std::sin(3.14f * u) + noise(random));
        uvs.emplace_back(u, v);
        normals.push_back(Eigen::Vector3f(std::cos(3.14f * u), 0, -std::sin(3.14f * u)).normalized());
        colors.push_back({static_cast<std::uint8_t>(255 * u), static_cast<std::uint8_t>(255 * v), 7});
      }
    }
    for (int y = 0; y + 1 < rows; ++y) {
      for (int x = 0; x + 1 < columns; ++x) {
        const auto a = static_cast<std::uint32_t>(y * columns + x),
                   b = a + static_cast<std::uint32_t>(columns);
        indices.insert(indices.end(), {a, b, a + 1, a + 1, b, b + 1});
      }
    }
  }
  std::vector<Eigen::Vector3f> positions, normals;
  std::vector<Eigen::Vector2f> uvs;
  std::vector<std::array<std::uint8_t, 3>> colors;
  std::vector<std::uint32_t> indices;
};

std::unique_ptr<draco::Mesh> Decode(const std::vector<std::uint8_t>& bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto mesh = decoder.DecodeMeshFromBuffer(&buffer);
  EXPECT_TRUE(mesh.ok()) << mesh.status().error_msg_string();
  return mesh.ok() ? std::move(mesh).value() : nullptr;
}

template <int N>
Eigen::Matrix<float, N, 1> Value(const draco::Mesh& mesh, draco::GeometryAttribute::Type type,
                                 std::uint32_t point) {
  const draco::PointAttribute* attribute = mesh.GetNamedAttribute(type);
  Eigen::Matrix<float, N, 1> value;
  attribute->ConvertValue<float, N>(attribute->mapped_index(draco::PointIndex(point)), value.data());
  return value;
}

TEST(DracoMesh, DecodesToTheSameSurfaceWithinItsPrecision) {
  const Sheet sheet(40, 60);
  const auto bytes =
      EncodeDraco({.positions = sheet.positions, .uvs = sheet.uvs, .indices = sheet.indices}, {});
  ASSERT_TRUE(bytes) << bytes.error().message;
  const auto mesh = Decode(*bytes);
  ASSERT_NE(mesh, nullptr);
  EXPECT_EQ(mesh->num_points(), sheet.positions.size());
  EXPECT_EQ(mesh->num_faces(), sheet.indices.size() / 3);
  // Vertices come in another order: a texture coordinate says which one it is.
  for (std::uint32_t i = 0; i < mesh->num_points(); ++i) {
    const Eigen::Vector2f uv = Value<2>(*mesh, draco::GeometryAttribute::TEX_COORD, i);
    const auto x = std::lround(uv.x() * 39), y = std::lround(uv.y() * 59);
    const auto vertex = static_cast<std::size_t>(y * 40 + x);
    ASSERT_LT((uv - sheet.uvs[vertex]).norm(), 1.0f / 1024);
    // Half a step of 1.8 m / 2^11 in each direction.
    const Eigen::Vector3f position = Value<3>(*mesh, draco::GeometryAttribute::POSITION, i);
    ASSERT_LT((position - sheet.positions[vertex]).cwiseAbs().maxCoeff(), 0.5f * 1.8f / 2047 + 1e-5f);
  }
}

TEST(DracoMesh, KeepsWindingNormalsAndColors) {
  const Sheet sheet(12, 12);
  const auto bytes = EncodeDraco({.positions = sheet.positions,
                                  .normals = sheet.normals,
                                  .colors = sheet.colors,
                                  .indices = sheet.indices},
                                 {.position_bits = 13});
  ASSERT_TRUE(bytes) << bytes.error().message;
  const auto mesh = Decode(*bytes);
  ASSERT_NE(mesh, nullptr);
  const auto* colors = mesh->GetNamedAttribute(draco::GeometryAttribute::COLOR);
  ASSERT_NE(colors, nullptr);
  EXPECT_EQ(colors->num_components(), 3);
  EXPECT_EQ(colors->data_type(), draco::DT_UINT8);
  for (std::uint32_t f = 0; f < mesh->num_faces(); ++f) {
    const auto& face = mesh->face(draco::FaceIndex(f));
    std::array<Eigen::Vector3f, 3> p;
    for (std::size_t k = 0; k < 3; ++k)
      p[k] = Value<3>(*mesh, draco::GeometryAttribute::POSITION, face[k].value());
    ASSERT_LT((p[1] - p[0]).cross(p[2] - p[0]).z(), 0) << "faces the camera";
  }
  for (std::uint32_t i = 0; i < mesh->num_points(); ++i) {
    const Eigen::Vector3f p = Value<3>(*mesh, draco::GeometryAttribute::POSITION, i);
    const Eigen::Vector3f n = Value<3>(*mesh, draco::GeometryAttribute::NORMAL, i);
    const float u = p.x() / 0.6f;
    ASSERT_LT((n - Eigen::Vector3f(std::cos(3.14f * u), 0, -std::sin(3.14f * u))).norm(), 0.03f);
    std::array<std::uint8_t, 3> rgb{};
    colors->GetMappedValue(draco::PointIndex(i), rgb.data());
    ASSERT_NEAR(rgb[0], 255 * u, 1.5) << "colours are exact";
    ASSERT_EQ(rgb[2], 7);
  }
}

TEST(DracoMesh, AnActorOf17ThousandVerticesTakes35Kilobytes) {
  const Sheet sheet(80, 212);
  const auto bytes =
      EncodeDraco({.positions = sheet.positions, .uvs = sheet.uvs, .indices = sheet.indices}, {});
  ASSERT_TRUE(bytes);
  EXPECT_LT(bytes->size(), 35'000u);
}

TEST(DracoMesh, NothingToEncodeIsAnError) {
  EXPECT_EQ(EncodeDraco({}, {}).error().code, ErrorCode::kInternal);
  const std::vector<Eigen::Vector3f> same(3, Eigen::Vector3f::Ones());
  const std::vector<std::uint32_t> flat = {0, 0, 0};
  EXPECT_FALSE(EncodeDraco({.positions = same, .indices = flat}, {}));
}

}  // namespace
}  // namespace mixstage
