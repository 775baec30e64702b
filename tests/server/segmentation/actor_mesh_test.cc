// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_mesh.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/segmentation/half_picture.h"
#include "tests/server/segmentation/mesh_coverage.h"

namespace mixstage {
namespace {

PinholeCamera Lens() {
  PinholeCamera camera;
  camera.width = 320, camera.height = 240;
  camera.fx = camera.fy = 340, camera.cx = 163.5, camera.cy = 117.25;
  camera.k1 = -0.12, camera.k2 = 0.06, camera.p1 = 0.001;
  return camera;
}

// A painted actor: coverage and depth, nothing else.
struct Actor {
  cv::Mat1b alpha = cv::Mat1b(240, 320, std::uint8_t{0});
  cv::Mat1f depth_m = cv::Mat1f(120, 160, 0.0f);

  void Paint(cv::Rect full, float z_m) {
    alpha(full).setTo(255);
    depth_m(cv::Rect(full.x / 2, full.y / 2, full.width / 2, full.height / 2)).setTo(z_m);
  }
  // A disc, antialiased as a camera sees it.
  void PaintDisc(double x, double y, double radius, float z_m) {
    for (int v = 0; v < alpha.rows; ++v) {
      for (int u = 0; u < alpha.cols; ++u) {
        const double inside = radius - std::hypot(u - x, v - y) + 0.5;
        alpha(v, u) = cv::saturate_cast<std::uint8_t>(255 * inside);
        if (inside > 0) depth_m(v / 2, u / 2) = z_m;
      }
    }
  }
  const PictureMesh& Mesh(ActorMesher& mesher, const RigidTransform& T = RigidTransform::Identity()) const {
    return mesher.Run(View(alpha), View(depth_m), T);
  }
};

void ExpectWellFormed(const PictureMesh& mesh) {
  ASSERT_EQ(mesh.indices.size() % 3, 0u);
  ASSERT_EQ(mesh.uvs.size(), mesh.positions.size());
  std::vector<bool> used(mesh.positions.size());
  for (const std::uint32_t i : mesh.indices) {
    ASSERT_LT(i, mesh.positions.size());
    used[i] = true;
  }
  EXPECT_TRUE(std::all_of(used.begin(), used.end(), [](bool u) { return u; }))
      << "a vertex without a triangle";
  for (const Eigen::Vector3f& p : mesh.positions) ASSERT_TRUE(p.allFinite());
  for (const Eigen::Vector2f& uv : mesh.uvs) {
    ASSERT_GE(uv.minCoeff(), 0);
    ASSERT_LE(uv.maxCoeff(), 1);
  }
  EXPECT_EQ(mesh.crop.x % 2, 0);
  EXPECT_EQ(mesh.crop.y % 2, 0);
}

TEST(ActorMesher, OutlineOfADiscIsWhereAlphaIsOneHalf) {
  Actor actor;
  actor.PaintDisc(150.3, 111.8, 60.4, 2.0f);
  auto mesher = ActorMesher::Create({}, Lens()).value();
  const PictureMesh& mesh = actor.Mesh(mesher);
  ExpectWellFormed(mesh);
  const cv::Mat1b covered = Coverage(mesh, actor.alpha.size());
  double farthest = 0;
  for (std::uint32_t i = 0; i < mesh.positions.size(); ++i) {
    farthest = std::max(farthest, (PixelOf(mesh, i) - Eigen::Vector2d(150.3, 111.8)).norm());
  }
  EXPECT_NEAR(farthest, 60.4, 0.25);  // alpha is not linear across a slanting edge
  EXPECT_NEAR(cv::countNonZero(covered), M_PI * 60.4 * 60.4, 0.01 * M_PI * 60.4 * 60.4);
}

TEST(ActorMesher, VerticesAreUnprojectedThroughTheRealLensIntoTheScene) {
  Actor actor;
  actor.Paint({40, 30, 200, 180}, 2.5f);
  RigidTransform T_scene_color = RigidTransform::Identity();
  T_scene_color.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
  T_scene_color.translation() << 1, -2, 3;
  const PinholeCamera lens = Lens();
  auto mesher = ActorMesher::Create({}, lens).value();
  const PictureMesh& mesh = actor.Mesh(mesher, T_scene_color);
  ASSERT_GT(mesh.positions.size(), 5000u);
  for (std::uint32_t i = 0; i < mesh.positions.size(); ++i) {
    const Eigen::Vector3d p_color = T_scene_color.inverse() * mesh.positions[i].cast<double>();
    ASSERT_NEAR(p_color.z(), 2.5, 1e-4);
    const auto pixel = lens.Project(p_color);
    ASSERT_TRUE(pixel);
    ASSERT_LT((*pixel - PixelOf(mesh, i)).norm(), 0.01);
  }
}

TEST(ActorMesher, TrianglesFaceTheCamera) {
  Actor actor;
  actor.PaintDisc(150.3, 111.8, 60.4, 2.0f);
  auto mesher = ActorMesher::Create({}, Lens()).value();
  const PictureMesh& mesh = actor.Mesh(mesher);
  for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
    const Eigen::Vector3f &a = mesh.positions[mesh.indices[t]], &b = mesh.positions[mesh.indices[t + 1]],
                          &c = mesh.positions[mesh.indices[t + 2]];
    ASSERT_LT((b - a).cross(c - a).dot(a + b + c), 0) << t;
  }
}

TEST(ActorMesher, AnArmBeforeTheBodyIsTornOffItWithoutAGap) {
  Actor actor;
  actor.Paint({60, 40, 160, 180}, 2.6f);
  actor.Paint({100, 100, 80, 40}, 2.2f);
  // As ActorSurface leaves it: enlarged linearly, so that the step is a slope of four pixels.
  cv::Mat1f quarter;
  cv::resize(actor.depth_m, quarter, {}, 0.5, 0.5, cv::INTER_NEAREST);
  for (float& z : quarter) z = z == 0 ? 2.6f : z;
  cv::resize(quarter, actor.depth_m, actor.depth_m.size(), 0, 0, cv::INTER_LINEAR);
  auto mesher = ActorMesher::Create({}, Lens()).value();
  for (const int max_vertices : {17'000, 3000, 1000}) {
    mesher = ActorMesher::Create({.max_vertices = max_vertices}, Lens()).value();
    const PictureMesh& mesh = actor.Mesh(mesher);
    ExpectWellFormed(mesh);
    EXPECT_LE(mesh.positions.size(), static_cast<std::size_t>(max_vertices));
    for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
      float nearest = 10, farthest = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        nearest = std::min(nearest, mesh.positions[mesh.indices[t + k]].z());
        farthest = std::max(farthest, mesh.positions[mesh.indices[t + k]].z());
      }
      ASSERT_LT(farthest - nearest, 0.16f) << "spans the step";
      ASSERT_TRUE(farthest < 2.25f || nearest > 2.55f) << "hangs between both";
    }
    const cv::Mat1b covered = Coverage(mesh, actor.alpha.size());
    const cv::Rect inside(64, 44, 152, 172);
    EXPECT_GT(cv::countNonZero(covered(inside)), 0.995 * inside.area()) << mesher.spacing_px();
  }
}

TEST(ActorMesher, NobodyInViewOrNoDepthIsAnEmptyMesh) {
  auto mesher = ActorMesher::Create({}, Lens()).value();
  Actor actor;
  EXPECT_TRUE(actor.Mesh(mesher).empty());
  actor.alpha.setTo(255);
  EXPECT_TRUE(actor.Mesh(mesher).empty());
  EXPECT_TRUE(
      mesher.Run(View(actor.alpha), View(actor.depth_m), RigidTransform::Identity()).positions.empty());
  actor.Paint({60, 40, 160, 180}, 2.6f);
  EXPECT_FALSE(actor.Mesh(mesher).empty());
  EXPECT_TRUE(Actor().Mesh(mesher).empty()) << "nothing of an earlier frame is left";
}

TEST(ActorMesher, AnActorWhoFillsThePictureReachesItsEdges) {
  Actor actor;
  actor.Paint({0, 0, 320, 240}, 1.5f);
  for (const int max_vertices : {100'000, 5000, 100}) {
    auto mesher = ActorMesher::Create({.max_vertices = max_vertices}, Lens()).value();
    const PictureMesh& mesh = actor.Mesh(mesher);
    ExpectWellFormed(mesh);
    EXPECT_LE(mesh.positions.size(), static_cast<std::size_t>(max_vertices));
    EXPECT_EQ(cv::countNonZero(Coverage(mesh, actor.alpha.size())), 320 * 240);
    EXPECT_EQ(mesh.crop, cv::Rect(0, 0, 320, 240));
  }
}

TEST(ActorMesher, RandomMattesMakeWellFormedMeshesWithinTheBound) {
  cv::RNG rng(5);
  for (int i = 0; i < 20; ++i) {
    Actor actor;
    rng.fill(actor.alpha, cv::RNG::UNIFORM, 0, 256);
    rng.fill(actor.depth_m, cv::RNG::UNIFORM, -1.0f, 6.0f);
    if (i % 2 == 0) cv::GaussianBlur(actor.alpha, actor.alpha, {}, 1 + i);
    auto mesher = ActorMesher::Create({.max_vertices = 4000}, Lens()).value();
    const PictureMesh& mesh = actor.Mesh(mesher);
    ExpectWellFormed(mesh);
    EXPECT_LE(mesh.positions.size(), 4000u);
  }
}

TEST(ActorMesher, SaysWhichValueIsOutOfRange) {
  EXPECT_EQ(ActorMesher::Create({.max_vertices = 10}, Lens()).error().code, ErrorCode::kInvalidConfig);
  EXPECT_EQ(ActorMesher::Create({.step_m = 0}, Lens()).error().code, ErrorCode::kInvalidConfig);
  EXPECT_FALSE(ActorMesher::Create({}, PinholeCamera()));
}

// The synthetic figure, whose surface is known exactly, from its exact matte and depth.
TEST(ActorMesher, LiesOnTheTrueFigureInsideItsTrueMatte) {
  auto scene = SyntheticScene::Create(SyntheticRig(), {}).value();
  const PinholeCamera& camera = scene.rig().color;
  auto mesher = ActorMesher::Create({}, camera).value();
  constexpr double t_s = 14.0;
  const cv::Mat1b matte = scene.TruthMatte(t_s);
  cv::Mat1f depth_m(Half(matte.rows), Half(matte.cols), 0.0f);
  const cv::Rect box = cv::boundingRect(matte);
  const auto figure_z = [&](double u, double v) {
    const auto truth = scene.TruthAt(SyntheticCamera::kColor, u, v, t_s);
    return truth && truth->figure ? truth->depth_m : 0.0f;
  };
  for (int y = box.y / 2; y < Half(box.br().y); ++y) {
    for (int x = box.x / 2; x < Half(box.br().x); ++x) depth_m(y, x) = figure_z(2 * x + 0.5, 2 * y + 0.5);
  }
  const PictureMesh& mesh = mesher.Run(View(matte), View(std::as_const(depth_m)), scene.TruthPose());
  ExpectWellFormed(mesh);
  EXPECT_LE(mesh.positions.size(), 17'000u);
  EXPECT_GT(mesh.positions.size(), 3000u);

  // Distances to the figure along the camera's rays. The outline has no depth of its own: there the surface
  // turns away from the camera, and the last pixel's depth stands.
  const RigidTransform T_color_world = scene.TruthPose().inverse();
  std::vector<double> distances_m;
  for (const Eigen::Vector3f& p : mesh.positions) {
    const Eigen::Vector3d p_color = T_color_world * p.cast<double>();
    const auto pixel = camera.Project(p_color);
    ASSERT_TRUE(pixel);
    const float z = figure_z(pixel->x(), pixel->y());
    if (z > 0) distances_m.push_back(std::abs(z - p_color.z()));
  }
  ASSERT_GT(distances_m.size(), 0.9 * static_cast<double>(mesh.positions.size()));
  std::sort(distances_m.begin(), distances_m.end());
  EXPECT_LT(distances_m[distances_m.size() / 2], 0.001);
  // A limb of 5 cm radius falls back by 16 mm over the outermost pixel.
  EXPECT_LT(distances_m[distances_m.size() * 90 / 100], 0.01);
  EXPECT_LT(distances_m[distances_m.size() * 95 / 100], 0.025);

  // Where mesh and matte disagree the matte's outline is near.
  const cv::Mat1b covered = Coverage(mesh, matte.size());
  const cv::Mat inside = matte >= 128, outside = matte < 128;
  cv::Mat1f to_outside, to_inside;
  cv::distanceTransform(inside, to_outside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::distanceTransform(outside, to_inside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  const cv::Mat missing = inside & (covered == 0) & (to_outside > 1.5f);
  const cv::Mat too_much = outside & covered & (to_inside > 1.5f);
  EXPECT_LE(cv::countNonZero(missing), cv::countNonZero(inside) / 2000);
  EXPECT_LE(cv::countNonZero(too_much), cv::countNonZero(inside) / 2000);

  // A triangle lies on the figure also in its middle: none spans a step.
  int spanning = 0;
  for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    double nearest = 100, farthest = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d p_color = T_color_world * mesh.positions[mesh.indices[t + k]].cast<double>();
      middle += p_color / 3;
      nearest = std::min(nearest, p_color.z());
      farthest = std::max(farthest, p_color.z());
    }
    if (farthest - nearest > 0.16) ++spanning;
  }
  EXPECT_EQ(spanning, 0);
}

}  // namespace
}  // namespace mixstage
