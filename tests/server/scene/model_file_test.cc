// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "server/scene/texture_file.h"
#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using testing::HasSubstr;

Result<LoadedModel> FromText(const std::string& name, const std::string& text) {
  test::TemporaryFolder folder;
  return LoadModel(folder.Write(name, text));
}
std::string ErrorOf(const std::string& name, const std::string& text) {
  auto model = FromText(name, text);
  return model ? "loaded" : model.error().message;
}
float Area(const Mesh& mesh) {
  float area = 0;
  for (std::size_t t = 0; t + 2 < mesh.indices.size(); t += 3) {
    const Eigen::Vector3f& a = mesh.positions[mesh.indices[t]];
    area += 0.5f *
            (mesh.positions[mesh.indices[t + 1]] - a).cross(mesh.positions[mesh.indices[t + 2]] - a).norm();
  }
  return area;
}

TEST(ObjImport, QuadBecomesTwoTrianglesWithItsMaterialAndTexture) {
  test::TemporaryFolder folder;
  cv::imwrite((folder.path() / "red.png").string(), cv::Mat3b(4, 4, cv::Vec3b(0, 0, 255)));
  folder.Write("quad.mtl", "newmtl painted\nKd 0.2 0.2 0.2\nmap_Kd red.png\n");
  folder.Write("quad.obj",
               "mtllib quad.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
               "usemtl painted\nf 1/1 2/2 3/3 4/4\n");
  auto model = LoadModel(folder.path() / "quad.obj");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_TRUE(model->warnings.empty());
  ASSERT_EQ(model->mesh.triangle_count(), 2u);
  EXPECT_EQ(model->mesh.positions.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {  // OBJ's v points up, ours down
    EXPECT_EQ(model->mesh.uvs[i],
              Eigen::Vector2f(model->mesh.positions[i].x(), 1 - model->mesh.positions[i].y()));
  }
  EXPECT_LT((model->mesh.normals[0] - Eigen::Vector3f(0, 0, 1)).norm(), 1e-6f);
  const Material& material = model->mesh.materials[static_cast<std::size_t>(model->mesh.parts[0].material)];
  ASSERT_EQ(material.texture, 0);
  EXPECT_EQ(model->mesh.textures[0].rgba(0, 0), cv::Vec4b(255, 0, 0, 255));
}

TEST(ObjImport, ConcavePolygonKeepsItsArea) {
  // An arrow head: a fan from any corner but one would cover more.
  auto model = FromText("arrow.obj", "v 0 0 0\nv 2 2 0\nv 0 1 0\nv -2 2 0\nf 4 1 2 3\n");
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_NEAR(Area(model->mesh), 2.0f, 1e-5f);
}

TEST(ObjImport, BrokenFilesAreNamed) {
  EXPECT_THAT(ErrorOf("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 3\n"), HasSubstr("vertex that does not exist"));
  EXPECT_THAT(ErrorOf("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/9 2/9 3/9\n"),
              HasSubstr("texture coordinate that does not"));
  EXPECT_THAT(ErrorOf("a.obj", ""), HasSubstr("holds no triangles"));
  EXPECT_THAT(ErrorOf("a.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), HasSubstr("line 1: a coordinate"));
  std::string wide = "v 0 0 0\nf";
  for (int i = 0; i < 300; ++i) wide += " 1";
  EXPECT_THAT(ErrorOf("a.obj", wide + "\n"), HasSubstr("line 2"));
}

TEST(ObjImport, SubdivisionTagsCostNothing) {
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  for (int i = 0; i < 20'000; ++i) text += "t x 8192/8192/8192\n";  // 6 GB, were they believed
  EXPECT_EQ(ErrorOf("a.obj", text), "loaded");
}

TEST(ObjImport, MissingMaterialsAreAWarning) {
  auto model = FromText("a.obj", "mtllib ../../etc/passwd\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  ASSERT_TRUE(model) << model.error().message;
  ASSERT_EQ(model->warnings.size(), 1u);
  EXPECT_THAT(model->warnings[0], HasSubstr("leads out of the model's folder"));
}

constexpr char kAsciiPly[] =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n"
    "0 0 0 255 0 0\n1 0 0 255 0 0\n1 1 0 255 0 0\n0 1 0 255 0 0\n4 0 1 2 3\n";

TEST(PlyImport, AsciiAndBinaryAgree) {
  auto ascii = FromText("a.ply", kAsciiPly);
  ASSERT_TRUE(ascii) << ascii.error().message;
  std::string binary =
      test::Replaced(std::string(kAsciiPly).substr(0, std::string(kAsciiPly).find("0 0 0 255")), "ascii",
                     "binary_little_endian");
  for (const auto& [x, y] : {std::pair{0.f, 0.f}, {1.f, 0.f}, {1.f, 1.f}, {0.f, 1.f}}) {
    binary += test::BytesOf<float>({x, y, 0}) + test::BytesOf<std::uint8_t>({255, 0, 0});
  }
  binary += test::BytesOf<std::uint8_t>({4}) + test::BytesOf<std::int32_t>({0, 1, 2, 3});
  auto same = FromText("b.ply", binary);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(ascii->mesh.positions, same->mesh.positions);
  EXPECT_EQ(ascii->mesh.indices, same->mesh.indices);
  EXPECT_EQ(same->mesh.triangle_count(), 2u);
  EXPECT_EQ(same->mesh.colors[0], Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(same->up, UpAxis::kZ);
  for (std::size_t cut = 0; cut < binary.size(); ++cut)
    EXPECT_NE(ErrorOf("c.ply", binary.substr(0, cut)), "loaded") << cut;
}

TEST(PlyImport, BrokenFilesAreNamed) {
  EXPECT_THAT(ErrorOf("a.ply", test::Replaced(kAsciiPly, "4 0 1 2 3", "4 0 1 2 9")),
              HasSubstr("beyond its vertices"));
  EXPECT_THAT(ErrorOf("a.ply", test::Replaced(kAsciiPly, "4 0 1 2 3", "4 0 1 2 -1")),
              HasSubstr("is no vertex"));
  EXPECT_THAT(ErrorOf("a.ply", test::Replaced(kAsciiPly, "vertex 4", "vertex 999999999999")),
              HasSubstr("element vertex"));
  EXPECT_THAT(ErrorOf("a.ply", test::Replaced(kAsciiPly, "ascii", "binary_big_endian")),
              HasSubstr("binary_big_endian"));
  EXPECT_THAT(ErrorOf("a.ply", test::Replaced(kAsciiPly, "0 0 0 255", "nan 0 0 255")),
              HasSubstr("position that is not a number"));
  EXPECT_THAT(ErrorOf("a.ply", test::Replaced(kAsciiPly, "vertex 4", "vertex 5")),
              HasSubstr("its data ends"));
}

TEST(ModelFile, UnknownKindsAndMissingFilesAreNamed) {
  EXPECT_THAT(ErrorOf("a.fbx", "x"), HasSubstr("a.fbx: is not a .glb"));
  auto missing = LoadModel("/nonexistent/a.glb");
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, HasSubstr("/nonexistent/a.glb: is missing"));
}

TEST(TextureFile, SizeIsCheckedBeforeDecoding) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", cv::Mat3b(5, 7), png);
  EXPECT_EQ(*PictureSize(png), cv::Size(7, 5));
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", cv::Mat3b(5, 7, cv::Vec3b(1, 2, 3)), jpeg);
  EXPECT_EQ(*PictureSize(jpeg), cv::Size(7, 5));
  png[16] = 0x7F;  // a width of two thousand million
  std::size_t budget = ModelLimits::kTexturePixels;
  auto bomb = DecodeTexture(png, budget);
  ASSERT_FALSE(bomb);
  EXPECT_THAT(bomb.error().message, HasSubstr("outside 1..8192"));
  std::size_t small_budget = 34;
  EXPECT_FALSE(DecodeTexture(jpeg, small_budget));
}

// Decoders skip what they do not know. A header that only we see must not stand for the picture that they
// see.
TEST(TextureFile, AHeaderThatTheDecoderSkipsIsRefused) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", cv::Mat3b(5, 7), png);
  const std::vector<std::uint8_t> chunk = {0, 0, 0, 13, 'a', 'b', 'C', 'd', 0,    0,    0,    2,   0,
                                           0, 0, 2, 8,  6,   0,   0,   0,   0x91, 0x9C, 0xB1, 0x09};
  png.insert(png.begin() + 8, chunk.begin(), chunk.end());
  EXPECT_FALSE(PictureSize(png));

  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", cv::Mat3b(5, 7, cv::Vec3b(1, 2, 3)), jpeg);
  const auto length = static_cast<std::uint16_t>(jpeg.size());  // of the whole picture, as of one segment
  const std::vector<std::uint8_t> stuffed = {0xFF, 0, static_cast<std::uint8_t>(length >> 8),
                                             static_cast<std::uint8_t>(length)};
  jpeg.insert(jpeg.begin() + 2, stuffed.begin(), stuffed.end());
  const std::vector<std::uint8_t> small_frame = {0xFF, 0xC0, 0, 17, 8, 0, 2, 0, 2, 3, 1, 0x11, 0, 2, 0x11, 0};
  jpeg.insert(jpeg.end(), small_frame.begin(), small_frame.end());
  EXPECT_FALSE(PictureSize(jpeg));
}

TEST(ModelFile, DemoObjectsLoadAndStandOnTheGround) {
  for (const char* name : {"amphora.glb", "sculpture.glb"}) {
    auto model = LoadModel(std::filesystem::path(MIXSTAGE_SOURCE_DIR) / "deploy/demo" / name);
    ASSERT_TRUE(model) << model.error().message;
    EXPECT_TRUE(model->warnings.empty());
    EXPECT_EQ(model->mesh.textures.size(), 2u);
    EXPECT_NEAR(model->mesh.Bounds().min().y(), 0.0f, 1e-6f);
    EXPECT_GT(model->mesh.Bounds().max().y(), 1.0f);
    EXPECT_LT(model->mesh.Bounds().max().y(), 1.5f);
  }
}

// Every model of a folder of found files: loads, or is refused with one line.
void TryFolder(const std::filesystem::path& folder, std::size_t& loaded, std::size_t& refused) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".glb" && extension != ".gltf" && extension != ".obj") continue;
    auto model = LoadModel(entry.path());
    if (model) {
      ++loaded;
      continue;
    }
    ++refused;
    EXPECT_THAT(model.error().message, testing::StartsWith(entry.path().string() + ": "));
    EXPECT_EQ(model.error().message.find('\n'), std::string::npos) << model.error().message;
  }
}

TEST(ModelFile, FoundFilesLoadOrAreRefusedInOneLine) {
  const std::filesystem::path folder =
      std::filesystem::path(MIXSTAGE_SOURCE_DIR) / "../shared/data/real/cg_objects";
  if (!std::filesystem::is_directory(folder)) GTEST_SKIP() << folder << " is not here";
  std::size_t loaded = 0;
  std::size_t refused = 0;
  TryFolder(folder, loaded, refused);
  EXPECT_GE(loaded, 10u);
  EXPECT_GE(refused, 20u);
  for (const char* name :
       {"Fox.glb", "MorphStressTest.gltf", "alien.glb", "cakeBirthday.glb", "stanford-bunny.obj",
        "teapot.obj", "spot_triangulated.obj", "odd_glb/transform_Box.glb",
        "odd_glb/transform_BoxVertexColors.glb", "odd_glb/transform_TwoCubes.glb",
        "odd_glb/tinygltf_singleBlendshapeCube_sparse.glb"}) {
    auto model = LoadModel(folder / name);
    EXPECT_TRUE(model) << model.error().message;
  }
  auto meshopt = LoadModel(folder / "odd_glb/transform_BoxMeshopt.glb");
  ASSERT_FALSE(meshopt);
  EXPECT_THAT(meshopt.error().message, HasSubstr("EXT_meshopt_compression"));
}

}  // namespace
}  // namespace mixstage
