// SPDX-License-Identifier: Apache-2.0
#include "server/scene/mesh_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "server/scene/model_file.h"
#include "server/scene/model_wire.h"
#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using test::MovingTriangle;
using test::Replaced;

Result<LoadedModel> Import(const std::string& file) {
  auto model = ImportGltf(std::vector<std::uint8_t>(file.begin(), file.end()), ".");
  if (!model) return model;
  if (auto ok = CheckMesh(model->mesh); !ok) return tl::unexpected(ok.error());
  return model;
}

// The triangle's second corner, which rests at (1, 0, 0) of its node.
Eigen::Vector3f CornerAt(const Mesh& mesh, float t_s) {
  return PoseMesh(*mesh.motion, 0, t_s).positions.at(1);
}

TEST(MeshMotion, ANodeGoesAlongALine) {
  const auto model = Import(MovingTriangle("translation", {1, 0, 0, 1, 0, 4}));
  ASSERT_TRUE(model) << model.error().message;
  ASSERT_NE(model->mesh.motion, nullptr);
  EXPECT_EQ(model->mesh.motion->clips.at(0).name, "go");
  EXPECT_EQ(model->mesh.motion->clips.at(0).duration_s, 2);
  EXPECT_EQ(model->mesh.positions[1], Eigen::Vector3f(2, 0, 0));
  EXPECT_LT((CornerAt(model->mesh, 0.5) - Eigen::Vector3f(2, 0, 1)).norm(), 1e-6f);
  EXPECT_EQ(CornerAt(model->mesh, 2.5), CornerAt(model->mesh, 2)) << "it ends";
  EXPECT_EQ(CornerAt(model->mesh, -1), CornerAt(model->mesh, 0));
}

TEST(MeshMotion, StepsWaitAndCubicTracksLeaveAlongTheirTangents) {
  const auto steps = Import(MovingTriangle("translation", {1, 0, 0, 1, 0, 4}, "STEP"));
  ASSERT_TRUE(steps) << steps.error().message;
  EXPECT_EQ(CornerAt(steps->mesh, 1.9f), Eigen::Vector3f(2, 0, 0));
  // Tangent, value, tangent of each key; Hermite's at the middle: (p0 + p1) / 2 + (m0 - m1) dt / 8.
  const auto cubic = Import(
      MovingTriangle("translation", {0, 0, 0, 1, 0, 0, 0, 8, 0, 0, 0, 0, 1, 0, 4, 0, 0, 0}, "CUBICSPLINE"));
  ASSERT_TRUE(cubic) << cubic.error().message;
  EXPECT_LT((CornerAt(cubic->mesh, 1) - Eigen::Vector3f(2, 2, 2)).norm(), 1e-5f);
}

TEST(MeshMotion, ARotationTakesTheShortWayAndTurnsNormals) {
  const float h = std::numbers::sqrt2_v<float> / 2;
  const auto model = Import(MovingTriangle("rotation", {0, 0, 0, 1, 0, -h, 0, -h}));  // 90 degrees about y
  ASSERT_TRUE(model) << model.error().message;
  const PosedVertices posed = PoseMesh(*model->mesh.motion, 0, 1);
  EXPECT_LT((posed.positions[1] - Eigen::Vector3f(1 + h, 0, -h)).norm(), 1e-5f);
  EXPECT_LT((posed.normals[1] - Eigen::Vector3f(h, 0, h)).norm(), 1e-5f);
}

TEST(MeshMotion, ASizeOfNothingIsNoTrouble) {
  const auto model = Import(MovingTriangle("scale", {0, 0, 0, 1, 1, 1}));
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ(model->mesh.positions[1], Eigen::Vector3f(1, 0, 0));
  EXPECT_LT((CornerAt(model->mesh, 1) - Eigen::Vector3f(1.5f, 0, 0)).norm(), 1e-6f);
}

// Between two ends of what a float holds, the step is none: the triangle stays where it rests.
TEST(MeshMotion, AStepThatNoFloatHoldsIsNoTrouble) {
  const auto model = Import(MovingTriangle("translation", {0, 3e38f, 0, 0, -3e38f, 0}));
  ASSERT_TRUE(model) << model.error().message;
  for (const float t_s : {0.0f, 0.5f, 1.0f, 2.0f})
    EXPECT_EQ(CornerAt(model->mesh, t_s), Eigen::Vector3f(1, 0, 0)) << t_s;
}

TEST(MeshMotion, TracksThatAreNoneAreNamed) {
  const auto why = [](const std::string& file) {
    const auto model = Import(file);
    return model ? std::string("loaded") : model.error().message;
  };
  EXPECT_NE(why(MovingTriangle("translation", {1, 0, 0})).find("one value a key"), std::string::npos);
  EXPECT_NE(why(MovingTriangle("translation", {1, 0, 0, NAN, 0, 4})).find("finite"), std::string::npos);
  EXPECT_NE(why(MovingTriangle("colour", {1, 0, 0, 1, 0, 4})).find("target.path"), std::string::npos);
  std::string back = MovingTriangle("translation", {1, 0, 0, 1, 0, 4});
  const std::string times = test::BytesOf<float>({0, 2});
  back = Replaced(back, times, test::BytesOf<float>({2, 0}));
  EXPECT_NE(why(back).find("rise"), std::string::npos);
}

TEST(MeshMotion, CrossesTheWireWhole) {
  const auto model = Import(MovingTriangle("translation", {1, 0, 0, 1, 0, 4}));
  ASSERT_TRUE(model);
  std::string bytes;
  ASSERT_TRUE(WriteModel(model, [&](const void* from, std::size_t count) {
    bytes.append(static_cast<const char*>(from), count);
    return true;
  }));
  std::size_t next = 0;
  const auto read = ReadModel([&](void* to, std::size_t count) {
    if (bytes.size() - next < count) return false;
    std::copy_n(bytes.data() + next, count, static_cast<char*>(to));
    next += count;
    return true;
  });
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_NE(read->mesh.motion, nullptr);
  EXPECT_EQ(CornerAt(read->mesh, 0.5), CornerAt(model->mesh, 0.5));
}

// A fox of 24 joints that looks round, walks and runs.
TEST(MeshMotion, ARealSkinKeepsItsLimbsLengthsAndComesBack) {
  const std::string file = MIXSTAGE_SOURCE_DIR "/../shared/data/real/cg_objects/Fox.glb";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not there";
  const auto model = LoadModel(file);
  ASSERT_TRUE(model) << model.error().message;
  const Mesh& mesh = model->mesh;
  ASSERT_NE(mesh.motion, nullptr);
  ASSERT_EQ(mesh.motion->clips.size(), 3u);
  EXPECT_EQ(mesh.motion->clips[1].name, "Walk");
  const float size = mesh.Bounds().diagonal().norm();
  for (int clip = 0; clip < 3; ++clip) {
    const float duration_s = mesh.motion->clips[static_cast<std::size_t>(clip)].duration_s;
    EXPECT_GT(duration_s, 0.3);
    double moved = 0;
    const std::vector<Eigen::Vector3f> positions = PoseMesh(*mesh.motion, clip, 0).positions;
    const std::vector<Eigen::Vector3f> last = PoseMesh(*mesh.motion, clip, duration_s).positions;
    // All three begin anew where they end.
    for (std::size_t i = 0; i < positions.size(); ++i)
      EXPECT_LT((positions[i] - last[i]).norm(), 1e-3f * size);
    for (const float part : {0.25f, 0.5f, 0.75f}) {
      const std::vector<Eigen::Vector3f> later = PoseMesh(*mesh.motion, clip, part * duration_s).positions;
      // A triangle's edges may stretch at a joint, not the most of them.
      double stretch = 0;
      std::size_t edges = 0;
      for (std::size_t t = 0; t + 1 < mesh.indices.size(); t += 3) {
        const auto a = mesh.indices[t], b = mesh.indices[t + 1];
        const double before = (positions[a] - positions[b]).norm(), after = (later[a] - later[b]).norm();
        if (before < 1e-4 * size) continue;
        stretch += std::abs(after / before - 1);
        ++edges;
      }
      EXPECT_LT(stretch / static_cast<double>(edges), 0.2) << clip << " at " << part;
      for (std::size_t i = 0; i < positions.size(); ++i)
        moved = std::max(moved, static_cast<double>((later[i] - positions[i]).norm()));
    }
    EXPECT_GT(moved, 0.02 * static_cast<double>(size)) << clip;
  }
}

}  // namespace
}  // namespace mixstage
