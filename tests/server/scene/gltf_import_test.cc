// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "server/scene/model_file.h"
#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using test::Glb;
using test::Replaced;
using test::TriangleBinary;
using test::TriangleJson;

Result<LoadedModel> Import(const std::string& file) {
  auto model = ImportGltf(std::vector<std::uint8_t>(file.begin(), file.end()), ".");
  if (!model) return model;
  if (auto ok = CheckMesh(model->mesh); !ok) return tl::unexpected(ok.error());
  return model;
}
std::string ErrorOf(const std::string& file) {
  auto model = Import(file);
  return model ? "loaded" : model.error().message;
}
Eigen::Vector3f Turn(const Mesh& mesh) {  // of the first triangle
  const auto& p = mesh.positions;
  const auto& i = mesh.indices;
  return (p[i[1]] - p[i[0]]).cross(p[i[2]] - p[i[0]]);
}

TEST(GltfImport, ReadsPositionsNormalsAndIndices) {
  auto model = Import(Glb(TriangleJson(), TriangleBinary()));
  ASSERT_TRUE(model) << model.error().message;
  ASSERT_EQ(model->mesh.triangle_count(), 1u);
  EXPECT_EQ(model->mesh.positions[1], Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(model->mesh.normals[2], Eigen::Vector3f(0, 0, 1));
  EXPECT_EQ(model->up, UpAxis::kY);
}

TEST(GltfImport, AppliesNodeTransforms) {
  auto model = Import(Glb(TriangleJson(R"(,"translation":[1,2,3],"scale":[2,2,2])"), TriangleBinary()));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ(model->mesh.positions[1], Eigen::Vector3f(3, 2, 3));
}

TEST(GltfImport, MirroringNodeKeepsTheOutside) {
  auto model = Import(Glb(TriangleJson(R"(,"scale":[-1,1,1])"), TriangleBinary()));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ(model->mesh.positions[1], Eigen::Vector3f(-1, 0, 0));
  EXPECT_GT(Turn(model->mesh).dot(model->mesh.normals[0]), 0.5f);
  EXPECT_EQ(model->mesh.normals[0], Eigen::Vector3f(0, 0, 1));
}

TEST(GltfImport, MissingNormalsAreTheFaces) {
  auto model = Import(Glb(Replaced(TriangleJson(), R"(,"NORMAL":1)", ""), TriangleBinary()));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_LT((model->mesh.normals[0] - Eigen::Vector3f(0, 0, 1)).norm(), 1e-6f);
}

TEST(GltfImport, SparseAccessorReplacesItsElements) {
  // Element 1 of POSITION becomes (5, 0, 0).
  std::string binary = TriangleBinary() + std::string(2, '\0');
  binary += test::BytesOf<std::uint32_t>({1}) + test::BytesOf<float>({5, 0, 0});
  std::string json = Replaced(
      TriangleJson(), R"("count":3,"type":"VEC3"})",
      R"("count":3,"type":"VEC3","sparse":{"count":1,"indices":{"bufferView":3,"componentType":5125},"values":{"bufferView":4}}})");
  json = Replaced(
      json, R"("byteLength":6}])",
      R"("byteLength":6},{"buffer":0,"byteOffset":80,"byteLength":4},{"buffer":0,"byteOffset":84,"byteLength":12}])");
  auto model = Import(Glb(Replaced(json, R"("byteLength":78)", R"("byteLength":96)"), binary));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ(model->mesh.positions[1], Eigen::Vector3f(5, 0, 0));
}

TEST(GltfImport, EmbeddedTextureKeepsItsColours) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", cv::Mat3b(2, 2, cv::Vec3b(10, 20, 200)), png);  // B G R
  const std::string json = Replaced(
      TriangleJson(
          "",
          R"(,"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0},"baseColorFactor":[0.5,1,1,1]}}],)"
          R"("textures":[{"source":0}],"images":[{"bufferView":3,"mimeType":"image/png"}])"),
      R"("byteLength":6}])",
      R"("byteLength":6},{"buffer":0,"byteOffset":78,"byteLength":)" + std::to_string(png.size()) + "}]");
  const std::string whole =
      Replaced(Replaced(json, R"("byteLength":78)", R"("byteLength":)" + std::to_string(78 + png.size())),
               R"("indices":2)", R"("indices":2,"material":0)");
  auto model = Import(Glb(whole, TriangleBinary() + std::string(png.begin(), png.end())));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_TRUE(model->warnings.empty()) << model->warnings[0];
  const Material& material = model->mesh.materials[static_cast<std::size_t>(model->mesh.parts[0].material)];
  EXPECT_EQ(material.base_color, Eigen::Vector3f(0.5f, 1, 1));
  ASSERT_EQ(material.texture, 0);
  EXPECT_EQ(model->mesh.textures[0].rgba(1, 1), cv::Vec4b(200, 20, 10, 255));
}

TEST(GltfImport, BrokenTextureIsOnlyAWarning) {
  const std::string json = Replaced(
      TriangleJson("", R"(,"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],)"
                       R"("textures":[{"source":0}],"images":[{"bufferView":0,"mimeType":"image/png"}])"),
      R"("indices":2)", R"("indices":2,"material":0)");
  auto model = Import(Glb(json, TriangleBinary()));
  ASSERT_TRUE(model) << model.error().message;
  ASSERT_EQ(model->warnings.size(), 1u);
  EXPECT_THAT(model->warnings[0], testing::HasSubstr("images[0]"));
}

struct Damage {
  const char *from, *to, *message;
};
class GltfDamage : public testing::TestWithParam<Damage> {};

TEST_P(GltfDamage, IsNamed) {
  EXPECT_THAT(ErrorOf(Glb(Replaced(TriangleJson(), GetParam().from, GetParam().to), TriangleBinary())),
              testing::HasSubstr(GetParam().message));
}
INSTANTIATE_TEST_SUITE_P(
    Json, GltfDamage,
    testing::Values(
        Damage{R"("count":3,"type":"VEC3")", R"("count":4,"type":"VEC3")",
               "accessors[0] reaches beyond its bufferView"},
        Damage{R"("count":3,"type":"VEC3")", R"("count":4000000000000000000,"type":"VEC3")",
               "accessors[0].count"},
        Damage{R"("count":3,"type":"VEC3")", R"("byteOffset":18446744073709551610,"count":3,"type":"VEC3")",
               "accessors[0]"},
        Damage{R"("byteLength":36})", R"("byteLength":3600})", "bufferViews[0] reaches beyond its buffer"},
        Damage{R"("byteLength":36})", R"("byteOffset":18446744073709551615,"byteLength":36})",
               "bufferViews[0]"},
        Damage{R"("byteLength":36})", R"("byteStride":4,"byteLength":36})", "byteStride"},
        Damage{R"("byteLength":78)", R"("byteLength":1e12)", "buffers[0].byteLength"},
        Damage{R"("byteLength":78)", R"("byteLength":100000000000)", "512 MB"},
        Damage{R"("nodes":[0])", R"("nodes":[7])", "nodes[7] does not exist"},
        Damage{R"("mesh":0)", R"("mesh":0,"children":[0])", "nodes[0] has two parents or is its own child"},
        Damage{R"("mesh":0)", R"("mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,2])", "nodes[0].matrix"},
        Damage{R"("mesh":0)", R"("mesh":9)", "meshes[9] does not exist"},
        Damage{R"("POSITION":0)", R"("POSITION":2)", "POSITION: accessors[2].type"},
        Damage{R"("indices":2)", R"("indices":0)", "indices: accessors[0]"},
        Damage{R"({"asset")", R"({"extensionsRequired":["EXT_meshopt_compression"],"asset")",
               "EXT_meshopt_compression"},
        Damage{R"("indices":2)", R"("indices":2,"mode":1)", "holds no triangles"}));

TEST(GltfImport, RefusesIndicesBeyondTheVertices) {
  std::string binary = TriangleBinary();
  binary[72] = 3;
  EXPECT_THAT(ErrorOf(Glb(TriangleJson(), binary)), testing::HasSubstr("is beyond its 3 vertices"));
}

TEST(GltfImport, RefusesPositionsThatAreNoNumbers) {
  std::string binary = TriangleBinary();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(binary.data() + 4, &nan, sizeof nan);
  EXPECT_THAT(ErrorOf(Glb(TriangleJson(), binary)), testing::HasSubstr("position that is not a number"));
}

TEST(GltfImport, RefusesAMeshThatIsReadAgainAndAgain) {
  std::string primitives, nodes, roots;
  for (int i = 0; i < 300; ++i) {
    const char* comma = i == 0 ? "" : ",";
    primitives += std::string(comma) + R"({"attributes":{"POSITION":0},"mode":0})";
    nodes += std::string(comma) + R"({"mesh":0})";
    roots += comma + std::to_string(i);
  }
  const std::string json = R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[)" + roots + R"(]}],"nodes":[)" +
                           nodes + R"(],"meshes":[{"primitives":[)" + primitives +
                           R"(]}],"accessors":[{"componentType":5126,"count":3,"type":"VEC3"}]})";
  EXPECT_NE(ErrorOf(json).find("limit of parts"), std::string::npos) << ErrorOf(json);
}

TEST(GltfImport, RefusesJsonNestedToBreakTheStack) {
  const std::string deep = std::string(100000, '[') + std::string(100000, ']');
  EXPECT_THAT(ErrorOf(Glb(TriangleJson("", ",\"extras\":" + deep), TriangleBinary())),
              testing::HasSubstr("nested deeper"));
}

TEST(GltfImport, EveryTruncationIsRefusedOrWhole) {
  const std::string whole = Glb(TriangleJson(), TriangleBinary());
  for (std::size_t size = 0; size + 4 < whole.size(); ++size) {
    EXPECT_NE(ErrorOf(whole.substr(0, size)), "loaded") << size;
  }
}

TEST(GltfImport, ReadsOnlyFilesOfItsOwnFolder) {
  test::TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "inside");
  folder.Write("secret.bin", TriangleBinary());
  folder.Write("inside/good.bin", TriangleBinary());
  std::filesystem::create_symlink(folder.path() / "secret.bin", folder.path() / "inside" / "link.bin");
  auto load = [&](const std::string& uri) {
    folder.Write("inside/model.gltf",
                 Replaced(TriangleJson(), R"("byteLength":78)", R"("byteLength":78,"uri":")" + uri + "\""));
    auto model = LoadModel(folder.path() / "inside" / "model.gltf");
    return model ? std::string("loaded") : model.error().message;
  };
  EXPECT_EQ(load("good.bin"), "loaded");
  EXPECT_THAT(load("../secret.bin"), testing::HasSubstr("leads out of the model's folder"));
  EXPECT_THAT(load("%2e%2e/secret.bin"), testing::HasSubstr("leads out of the model's folder"));
  EXPECT_THAT(load("link.bin"), testing::HasSubstr("leads out of the model's folder"));
  EXPECT_THAT(load("http://example.org/good.bin"), testing::HasSubstr("not relative"));
  EXPECT_THAT(load("missing.bin"), testing::HasSubstr("missing.bin"));
  EXPECT_NE(load((folder.path() / "secret.bin").string()), "loaded");
}

}  // namespace
}  // namespace mixstage
