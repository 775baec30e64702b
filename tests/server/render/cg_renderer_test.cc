// SPDX-License-Identifier: Apache-2.0
#include "server/render/cg_renderer.h"

#include <gtest/gtest.h>

#include <optional>

#include "tests/server/render/test_scenes.h"
#include "tests/server/scene/test_motion.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage {
namespace {

using test::At;
using test::CameraScene;
using test::DistortedCamera;
using test::EvenAmbient;
using test::EvenLight;
using test::Placed;
using test::Rectangle;
using test::StraightCamera;

// What holds for a back end holds for each.
class CgRendererTest : public testing::TestWithParam<RasterBackend> {
 protected:
  void SetUp() override {
    if (GetParam() == RasterBackend::kEgl) MIXSTAGE_SKIP_WITHOUT_EGL();
  }
};
INSTANTIATE_TEST_SUITE_P(BackEnds, CgRendererTest, testing::Values(RasterBackend::kCpu, RasterBackend::kEgl),
                         [](const auto& each) { return each.param == RasterBackend::kCpu ? "cpu" : "egl"; });

class Stage {
 public:
  explicit Stage(const PinholeCamera& camera)
      : renderer_(*CgRenderer::Create({}, camera, {CgRendererTest::GetParam(), test::SharedGpu()})) {}
  const CgLayer& Draw(const Scene& scene, const Illumination& light = EvenLight()) {
    return renderer_.Run(scene, RigidTransform::Identity(), light);
  }

 private:
  CgRenderer renderer_;
};

std::optional<cv::Vec4f> ColorAt(const CgLayer& layer, int u, int v) {
  if (!layer.bounds.contains({u, v})) return std::nullopt;
  return layer.color(v - layer.bounds.y, u - layer.bounds.x);
}
float DepthAt(const CgLayer& layer, int u, int v) {
  return layer.bounds.contains({u, v}) ? layer.depth_m(v - layer.bounds.y, u - layer.bounds.x) : 0.0f;
}
double Coverage(const CgLayer& layer) { return layer.bounds.empty() ? 0 : cv::sum(layer.color)[3]; }

// What a material of this colour shows in even light of 1: diffuse, and 4 % mirrored.
float Shown(float albedo) { return albedo + 0.04f; }

// Left half red, right half blue.
Mesh TwoColours() {
  Mesh mesh = Rectangle(1, 1, 4);
  Texture texture;
  texture.rgba = cv::Mat4b(64, 64, cv::Vec4b(255, 0, 0, 255));
  texture.rgba.colRange(32, 64).setTo(cv::Scalar(0, 0, 255, 255));
  texture.wrap_u = texture.wrap_v = TextureWrap::kClamp;
  mesh.textures.push_back(texture);
  mesh.materials[0].texture = 0;
  return mesh;
}

TEST_P(CgRendererTest, TextureLandsWhereTheCameraModelSays) {
  for (const PinholeCamera& camera : {StraightCamera(), DistortedCamera()}) {
    Stage stage(camera);
    const Eigen::Affine3d T = At(0.6, 0.3, 2.5) * Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY()) *
                              Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ());
    const CgLayer& layer = stage.Draw(CameraScene({Placed(TwoColours(), T)}));
    for (double y = -0.45; y <= 0.45; y += 0.15) {
      // On both sides of the colours' border, and inside and outside the right edge: 1.5 px each way.
      const Eigen::Vector2d border = *camera.Project(T * Eigen::Vector3d(0, y, 0));
      const Eigen::Vector2d edge = *camera.Project(T * Eigen::Vector3d(0.5, y, 0));
      const Eigen::Vector2d across = (edge - border).normalized();
      auto at = [&](const Eigen::Vector2d& p) {
        return ColorAt(layer, static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y())))
            .value_or(cv::Vec4f());
      };
      EXPECT_NEAR(at(border - 2.5 * across)[0], Shown(1), 0.05) << y;
      EXPECT_NEAR(at(border + 2.5 * across)[2], Shown(1), 0.05) << y;
      EXPECT_NEAR(at(edge - 1.5 * across)[3], 1, 1e-6) << y;
      EXPECT_NEAR(at(edge + 1.5 * across)[3], 0, 1e-6) << y;
    }
  }
}

// Area of a polygon of picture points.
double Area(const std::vector<Eigen::Vector2d>& outline) {
  double twice = 0;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Eigen::Vector2d& a = outline[i];
    const Eigen::Vector2d& b = outline[(i + 1) % outline.size()];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return std::abs(0.5 * twice);
}

TEST_P(CgRendererTest, CoverageSumsToTheAnalyticArea) {
  for (const PinholeCamera& camera : {StraightCamera(), DistortedCamera()}) {
    Stage stage(camera);
    const Eigen::Affine3d T = At(0.37, -0.21, 2.2) * Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitX()) *
                              Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ());
    const CgLayer& layer = stage.Draw(CameraScene({Placed(Rectangle(0.9f, 0.7f), T)}));
    std::vector<Eigen::Vector2d> outline;
    const Eigen::Vector3d corners[4] = {
        {-0.45, -0.35, 0}, {0.45, -0.35, 0}, {0.45, 0.35, 0}, {-0.45, 0.35, 0}};
    for (int side = 0; side < 4; ++side) {
      for (int i = 0; i < 50; ++i) {
        outline.push_back(
            *camera.Project(T * (corners[side] + i / 50.0 * (corners[(side + 1) % 4] - corners[side]))));
      }
    }
    EXPECT_NEAR(Coverage(layer), Area(outline), 0.01 * Area(outline));
  }
}

TEST_P(CgRendererTest, DepthIsWhereTheRayMeetsThePlane) {
  const PinholeCamera camera = DistortedCamera();
  Stage stage(camera);
  const Eigen::Affine3d T = At(0, 0, 3) * Eigen::AngleAxisd(0.8, Eigen::Vector3d::UnitY());
  const CgLayer& layer = stage.Draw(CameraScene({Placed(Rectangle(2, 1), T)}));
  const Eigen::Vector3d normal = T.linear() * Eigen::Vector3d::UnitZ();
  int compared = 0;
  for (int v = 0; v < camera.height; v += 3) {
    for (int u = 0; u < camera.width; u += 3) {
      const auto color = ColorAt(layer, u, v);
      if (!color || (*color)[3] < 1) continue;
      const Eigen::Vector3d ray = camera.Unproject(Eigen::Vector2d(u, v))->homogeneous();
      EXPECT_NEAR(DepthAt(layer, u, v), normal.dot(T.translation()) / normal.dot(ray), 1e-4);
      ++compared;
    }
  }
  EXPECT_GT(compared, 1000);
}

TEST_P(CgRendererTest, NearerObjectHidesTheFarther) {
  Mesh red = Rectangle(1, 1);
  red.materials[0].base_color = {1, 0, 0};
  Mesh green = Rectangle(1, 1);
  green.materials[0].base_color = {0, 1, 0};
  for (const bool red_first : {true, false}) {
    std::vector<SceneObject> objects = {Placed(red, At(-0.2, 0, 3)), Placed(green, At(0.2, 0, 2.5))};
    if (!red_first) std::swap(objects[0], objects[1]);
    Stage stage(StraightCamera());
    const CgLayer& layer = stage.Draw(CameraScene(objects));
    EXPECT_NEAR((*ColorAt(layer, 160, 120))[1], Shown(1), 1e-3);
    EXPECT_NEAR(DepthAt(layer, 160, 120), 2.5, 1e-4);
    EXPECT_EQ(layer.object_id(120 - layer.bounds.y, 160 - layer.bounds.x), red_first ? 2 : 1);
    EXPECT_NEAR((*ColorAt(layer, 100, 120))[0], Shown(1), 1e-3);  // the red one alone
  }
}

TEST_P(CgRendererTest, PixelsOfTwoSurfacesAreMixedInLinearLight) {
  // A bright rectangle over a dark one; the bright one's left edge cuts column 160 in half.
  Mesh dark = Rectangle(2, 2);
  dark.materials[0].base_color.setZero();
  const PinholeCamera camera = StraightCamera();
  const double edge_m = (160 - camera.cx) / camera.fx * 2.0;
  Stage stage(camera);
  const CgLayer& layer =
      stage.Draw(CameraScene({Placed(dark, At(0, 0, 3)), Placed(Rectangle(1, 1), At(edge_m + 0.5, 0, 2))}));
  EXPECT_NEAR((*ColorAt(layer, 160, 120))[0], 0.5f * (Shown(0) + Shown(1)), 1e-3);
  EXPECT_FLOAT_EQ((*ColorAt(layer, 160, 120))[3], 1.0f);
}

TEST_P(CgRendererTest, LitSideIsBrighter) {
  // A roof of two slopes, the sun from the left.
  Illumination light = EvenLight();
  light.ambient = EvenAmbient(0.1f);
  Light sun;
  sun.shape = DirectionalLight{Eigen::Vector3d(-1, 0, -1).normalized()};
  light.lights.push_back(sun);
  const Eigen::AngleAxisd left(0.7, Eigen::Vector3d::UnitY());
  const Eigen::AngleAxisd right(-0.7, Eigen::Vector3d::UnitY());
  Stage stage(StraightCamera());
  const CgLayer& layer = stage.Draw(CameraScene({Placed(Rectangle(1, 1), At(-0.5, 0, 3) * left),
                                                 Placed(Rectangle(1, 1), At(0.5, 0, 3) * right)}),
                                    light);
  EXPECT_GT((*ColorAt(layer, 110, 120))[0], 3 * (*ColorAt(layer, 210, 120))[0]);
}

TEST_P(CgRendererTest, PointLightFallsWithTheSquareOfItsDistance) {
  Illumination light;
  Light lamp;
  lamp.shape = PointLight{Eigen::Vector3d(0, 0, 1)};
  light.lights.push_back(lamp);
  Mesh matt = Rectangle(1, 1);
  Stage stage(StraightCamera());
  const float near_one = (*ColorAt(stage.Draw(CameraScene({Placed(matt, At(0, 0, 2))}), light), 160, 120))[0];
  const float far_one = (*ColorAt(stage.Draw(CameraScene({Placed(matt, At(0, 0, 3))}), light), 160, 120))[0];
  EXPECT_NEAR(near_one, 1.0f, 0.05f);  // a white surface 1 m from a lamp of 1
  EXPECT_NEAR(near_one / far_one, 4.0f, 0.1f);
}

TEST_P(CgRendererTest, OneSidedSurfacesAreNotSeenFromBehind) {
  const Eigen::Affine3d turned = At(0, 0, 3) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY());
  Mesh two_sided = Rectangle(1, 1);
  two_sided.materials[0].double_sided = true;
  Stage stage(StraightCamera());
  EXPECT_EQ(Coverage(stage.Draw(CameraScene({Placed(Rectangle(1, 1), turned)}))), 0);
  EXPECT_NEAR(Coverage(stage.Draw(CameraScene({Placed(two_sided, turned)}))), 1e4, 1e2);
}

TEST_P(CgRendererTest, BackOfATwoSidedSurfaceAndAMirroredFrontAreLitLikeAFront) {
  Illumination light;
  Light sun;
  sun.shape = DirectionalLight{Eigen::Vector3d(0, 0, -1)};
  light.lights.push_back(sun);
  Mesh two_sided = Rectangle(1, 1);
  two_sided.materials[0].double_sided = true;
  Stage stage(StraightCamera());
  auto brightness = [&](const Mesh& mesh, const Eigen::Affine3d& T) {
    return (*ColorAt(stage.Draw(CameraScene({Placed(mesh, T)}), light), 160, 120))[0];
  };
  const float front = brightness(Rectangle(1, 1), At(0, 0, 3));
  EXPECT_GT(front, 0.9f);
  EXPECT_NEAR(brightness(two_sided, At(0, 0, 3) * Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY())), front,
              1e-3);
  const Eigen::Affine3d mirrored = At(0, 0, 3) * Eigen::Scaling(-1.0, 1.0, 1.0);
  EXPECT_NEAR(brightness(Rectangle(1, 1), mirrored), front, 1e-3);
  EXPECT_NEAR(brightness(two_sided, mirrored), front, 1e-3);
}

TEST_P(CgRendererTest, MinifiedTextureShowsItsMean) {
  // A checkerboard of single texels, 1024 across some 50 pixels: anything but the mean would be a moire.
  Mesh mesh = Rectangle(0.5f, 0.5f);
  Texture texture;
  texture.rgba = cv::Mat4b(1024, 1024);
  for (int y = 0; y < 1024; ++y) {
    for (int x = 0; x < 1024; ++x)
      texture.rgba(y, x) = (x + y) % 2 == 0 ? cv::Vec4b(255, 255, 255, 255) : cv::Vec4b(0, 0, 0, 255);
  }
  mesh.textures.push_back(texture);
  mesh.materials[0].texture = 0;
  Stage stage(StraightCamera());
  const CgLayer& layer =
      stage.Draw(CameraScene({Placed(mesh, At(0, 0, 3) * Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitX()))}));
  int inside = 0;
  for (const cv::Vec4f& p : layer.color) {
    if (p[3] < 1) continue;
    EXPECT_NEAR(p[0], Shown(0.5f), 0.01f);
    ++inside;
  }
  EXPECT_GT(inside, 500);
}

TEST_P(CgRendererTest, MaskedTexelsAreNotThere) {
  Mesh mesh = TwoColours();
  Texture& texture = mesh.textures[0];
  texture.rgba.colRange(0, 32).setTo(cv::Scalar(255, 0, 0, 0));
  mesh.materials[0].alpha_mask = true;
  Stage stage(StraightCamera());
  const CgLayer& layer = stage.Draw(CameraScene({Placed(mesh, At(0, 0, 3))}));
  EXPECT_NEAR(Coverage(layer), 0.5e4, 1e2);
  EXPECT_EQ(DepthAt(layer, 130, 120), 0);
  EXPECT_NEAR(DepthAt(layer, 190, 120), 3, 1e-4);
}

TEST_P(CgRendererTest, LayerRestsWhileNothingChanges) {
  Scene scene = CameraScene({Placed(Rectangle(1, 1), At(0, 0, 3))});
  Stage stage(StraightCamera());
  const std::uint64_t first = stage.Draw(scene).drawing;
  EXPECT_EQ(stage.Draw(scene).drawing, first);
  scene.objects[0].T_scene_object = At(0.1, 0, 3);
  const std::uint64_t moved = stage.Draw(scene).drawing;
  EXPECT_NE(moved, first);
  Illumination dimmed = EvenLight();
  dimmed.ambient = EvenAmbient(0.5f);
  EXPECT_NE(stage.Draw(scene, dimmed).drawing, moved);
}

TEST_P(CgRendererTest, AnAnimatedObjectIsDrawnWhereItHasGone) {
  Stage stage(DistortedCamera());
  Scene scene = CameraScene({Placed(TwoColours(), At(-1, 0, 4))});
  SceneObject& object = scene.objects[0];
  object.mesh = test::Moving(*object.mesh);
  stage.Draw(scene);
  object.posed = std::make_shared<const PosedVertices>(PoseMesh(*object.mesh->motion, 0, 0.5f));  // 1 m
  const CgLayer& moved = stage.Draw(scene);
  Stage other(DistortedCamera());
  const CgLayer& there = other.Draw(CameraScene({Placed(TwoColours(), At(0, 0, 4))}));
  ASSERT_EQ(moved.bounds, there.bounds);
  EXPECT_LT(cv::norm(moved.color, there.color, cv::NORM_INF), 1e-3);
  EXPECT_LT(cv::norm(moved.depth_m, there.depth_m, cv::NORM_INF), 1e-4);
}

TEST_P(CgRendererTest, SmallerRedrawLeavesNothingOfTheLarger) {
  Stage used(StraightCamera());
  used.Draw(CameraScene({Placed(Rectangle(2, 2), At(0, 0, 3))}));
  const Scene small = CameraScene({Placed(Rectangle(0.5f, 0.5f), At(0.3, 0, 3))});
  const CgLayer& after = used.Draw(small);
  Stage fresh(StraightCamera());
  const CgLayer& alone = fresh.Draw(small);
  ASSERT_EQ(after.bounds, alone.bounds);
  EXPECT_EQ(cv::norm(after.color, alone.color, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(after.depth_m, alone.depth_m, cv::NORM_INF), 0);
}

TEST_P(CgRendererTest, BoundsAreEvenAndInsideThePicture) {
  Stage stage(StraightCamera());
  for (const Eigen::Affine3d& T : {At(0.013, 0.007, 3), At(1.6, 0, 3), At(-1.7, -1.2, 3), At(0, 0, 0.3)}) {
    const cv::Rect bounds = stage.Draw(CameraScene({Placed(Rectangle(1, 1), T)})).bounds;
    EXPECT_EQ((bounds & cv::Rect(0, 0, 320, 240)), bounds);
    EXPECT_EQ(bounds.x % 2 + bounds.y % 2 + bounds.width % 2 + bounds.height % 2, 0);
    EXPECT_FALSE(bounds.empty());
  }
}

TEST_P(CgRendererTest, NothingInViewIsAnEmptyLayer) {
  Stage stage(DistortedCamera());
  EXPECT_TRUE(stage.Draw(CameraScene({})).bounds.empty());
  EXPECT_TRUE(stage.Draw(CameraScene({Placed(Rectangle(1, 1), At(0, 0, -3))})).bounds.empty());
  EXPECT_TRUE(stage.Draw(CameraScene({Placed(Rectangle(1, 1), At(50, 0, 3))})).bounds.empty());
}

TEST_P(CgRendererTest, InvalidCameraIsRefused) {
  PinholeCamera camera = StraightCamera();
  camera.fx = 0;
  EXPECT_FALSE(CgRenderer::Create({}, camera));
}

}  // namespace
}  // namespace mixstage
