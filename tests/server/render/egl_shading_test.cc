// SPDX-License-Identifier: Apache-2.0
//
// The CG layer on both back ends.
//
// Tolerances. Samples are the same but for single pixels (egl_rasteriser_test.cc); GL may contract and
// reorder floating point, which moves a footprint's number of taps or a lobe's last digits: 2/255 of white in
// linear light, and 0.5 % of the pixels may hold another surface in one of their samples.
#include "server/render/egl_shading.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/scene/scene_file.h"
#include "tests/server/render/test_scenes.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage {
namespace {

using test::At;
using test::CameraScene;
using test::DistortedCamera;
using test::Placed;
using test::Rectangle;
using test::StraightCamera;

RenderDevice Egl() { return {RasterBackend::kEgl, test::SharedGpu()}; }

void ExpectSame(const CgLayer& cpu, const CgLayer& egl, int least_covered) {
  ASSERT_EQ(cpu.bounds, egl.bounds);
  if (cpu.bounds.empty()) return;
  int covered = 0, color = 0, depth = 0, id = 0;
  for (int y = 0; y < cpu.color.rows; ++y) {
    for (int x = 0; x < cpu.color.cols; ++x) {
      const cv::Vec4f difference = cpu.color(y, x) - egl.color(y, x);
      covered += cpu.color(y, x)[3] > 0;
      float worst = 0;
      for (int c = 0; c < 4; ++c) {
        ASSERT_TRUE(std::isfinite(egl.color(y, x)[c]));
        worst = std::max(worst, std::abs(difference[c]));
      }
      // Bright highlights: relative to what is there.
      color += worst > 2.0f / 255 * std::max(1.0f, static_cast<float>(cv::norm(cpu.color(y, x))));
      depth += std::abs(cpu.depth_m(y, x) - egl.depth_m(y, x)) > 1e-3f;
      id += cpu.object_id(y, x) != egl.object_id(y, x);
    }
  }
  EXPECT_GE(covered, least_covered);
  EXPECT_LE(color, 1 + covered / 200);
  EXPECT_LE(depth, 1 + covered / 200);
  EXPECT_LE(id, 1 + covered / 200);
}

class EglShadingTest : public testing::Test {
 protected:
  void SetUp() override { MIXSTAGE_SKIP_WITHOUT_EGL(); }
  static void Compare(const PinholeCamera& camera, const Scene& scene, const RigidTransform& T_camera_scene,
                      const Illumination& light, int least_covered) {
    auto cpu = *CgRenderer::Create({}, camera);
    auto egl = *CgRenderer::Create({}, camera, Egl());
    ExpectSame(cpu.Run(scene, T_camera_scene, light), egl.Run(scene, T_camera_scene, light), least_covered);
  }
};

// One lamp of every kind, none of them white.
Illumination Lamps() {
  Illumination light;
  light.ambient = test::UnevenAmbient();
  const Light sun{.name = "sun",
                  .shape = DirectionalLight{Eigen::Vector3d(-0.5, -1, -1).normalized()},
                  .color = {1, 0.9f, 0.8f},
                  .intensity = 0.4f};
  Light point;
  point.shape = PointLight{Eigen::Vector3d(0.5, -0.5, 1.5)};
  point.intensity = 0.5f;
  Light area;
  area.shape =
      AreaLight{Eigen::Vector3d(-1, -1.5, 2), Eigen::Vector3d(0.5, 0, 0), Eigen::Vector3d(0, 0, -0.5)};
  area.intensity = 3;
  light.lights = {sun, point, area};
  return light;
}

// Smooth colours, with alpha from 0 to 1 across; odd sides, so that mip levels are uneven.
Texture Pattern(TextureWrap wrap) {
  Texture texture;
  texture.rgba = cv::Mat4b(37, 61);
  for (int y = 0; y < 37; ++y) {
    for (int x = 0; x < 61; ++x) {
      auto wave = [](double t) { return static_cast<std::uint8_t>(127.5 + 127.5 * std::sin(t)); };
      texture.rgba(y, x) = {wave(0.3 * x), wave(0.5 * y), wave(0.2 * (x + y)), wave(0.25 * x + 1)};
    }
  }
  texture.wrap_u = texture.wrap_v = wrap;
  return texture;
}

Mesh Bumpy(TextureWrap wrap, float metallic, float roughness) {
  Mesh mesh = Rectangle(1, 1, 12);
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    Eigen::Vector3f& p = mesh.positions[i];
    p.z() = 0.1f * std::sin(7 * p.x()) * std::cos(5 * p.y());
    mesh.normals[i] =
        Eigen::Vector3f(0.7f * std::cos(7 * p.x()), -0.5f * std::sin(5 * p.y()), -1).normalized();
    mesh.uvs[i] = Eigen::Vector2f(3 * mesh.uvs[i].x() - 1, 2 * mesh.uvs[i].y() - 0.6f);
  }
  mesh.textures.push_back(Pattern(wrap));
  mesh.materials[0].texture = 0;
  mesh.materials[0].metallic = metallic;
  mesh.materials[0].roughness = roughness;
  mesh.materials[0].double_sided = true;
  return mesh;
}

Scene EverythingScene() {
  Mesh masked = Bumpy(TextureWrap::kMirror, 0, 0.5f);
  masked.materials[0].alpha_mask = true;
  masked.materials[0].base_color = {0.9f, 0.5f, 0.3f};
  Mesh colored = Bumpy(TextureWrap::kClamp, 0.6f, 0.3f);
  for (const Eigen::Vector3f& p : colored.positions)
    colored.colors.emplace_back(p.x() + 0.5f, 1, 0.5f - p.y());
  Mesh plain = Rectangle(3, 2, 3);
  plain.materials[0].base_color = {0.2f, 0.4f, 0.6f};
  const Eigen::AngleAxisd turn(0.7, Eigen::Vector3d(1, 2, 0.5).normalized());
  const Eigen::AngleAxisd grazing(1.45, Eigen::Vector3d::UnitX());
  return CameraScene({Placed(plain, At(0, 0.2, 4)),
                      Placed(Bumpy(TextureWrap::kRepeat, 0, 0.9f), At(-0.7, -0.4, 2.5) * turn),
                      Placed(masked, At(0.2, 0, 2) * turn),
                      Placed(colored, At(0.7, 0.3, 2.6) * Eigen::Scaling(-1.0, 1.0, 1.0)),
                      Placed(Bumpy(TextureWrap::kRepeat, 1, 0.15f), At(0, 0.6, 2.4) * grazing)});
}

TEST_F(EglShadingTest, EveryKindOfMaterialTextureAndLampLooksTheSame) {
  for (const PinholeCamera& camera : {StraightCamera(), DistortedCamera()}) {
    Compare(camera, EverythingScene(), RigidTransform::Identity(), Lamps(), 20'000);
  }
}

TEST_F(EglShadingTest, ObjectsThroughTheNearPlaneLookTheSame) {
  const Scene scene =
      CameraScene({Placed(Bumpy(TextureWrap::kRepeat, 0, 0.8f),
                          At(0, 0.1, 0.2) * Eigen::AngleAxisd(1.2, Eigen::Vector3d::UnitX()))});
  Compare(DistortedCamera(), scene, RigidTransform::Identity(), Lamps(), 5000);
}

TEST_F(EglShadingTest, DemoObjectsLookTheSame) {
  const auto scene = LoadScene(std::string(MIXSTAGE_SOURCE_DIR) + "/deploy/demo/scene.yaml", LoadModel);
  ASSERT_TRUE(scene) << scene.error().message;
  const Rig rig = SyntheticRig();
  PinholeCamera camera = rig.color;
  camera.width /= 2, camera.height /= 2;
  camera.fx /= 2, camera.fy /= 2;
  camera.cx = (camera.cx + 0.5) / 2 - 0.5, camera.cy = (camera.cy + 0.5) / 2 - 0.5;
  Compare(camera, scene->scene, SyntheticTWorldColor(rig).inverse(), IlluminationOf(scene->scene, nullptr),
          5000);
}

TEST_F(EglShadingTest, ChangesOfSceneLightAndPoseAreSent) {
  auto cpu = *CgRenderer::Create({}, DistortedCamera());
  auto egl = *CgRenderer::Create({}, DistortedCamera(), Egl());
  Scene scene = EverythingScene();
  Illumination light = Lamps();
  auto compare = [&](int least) {
    ExpectSame(cpu.Run(scene, RigidTransform::Identity(), light),
               egl.Run(scene, RigidTransform::Identity(), light), least);
  };
  compare(20'000);
  scene.objects[1].T_scene_object = At(0.5, 0.5, 3);
  compare(20'000);
  scene.objects.erase(scene.objects.begin() + 2);
  compare(20'000);
  light.lights.pop_back();
  compare(20'000);
  scene.objects.push_back(Placed(Bumpy(TextureWrap::kClamp, 0, 1), At(-0.5, 0.3, 2)));
  compare(20'000);
  scene.objects.clear();
  compare(0);
  EXPECT_TRUE(egl.Run(scene, RigidTransform::Identity(), light).bounds.empty());
}

TEST_F(EglShadingTest, ALostContextCostsNoLayer) {
  auto gpu = *gl::Gpu::Create();
  auto cpu = *CgRenderer::Create({}, DistortedCamera());
  auto egl = *CgRenderer::Create({}, DistortedCamera(), {RasterBackend::kEgl, gpu});
  Scene scene = EverythingScene();
  for (int i = 0; i < 4; ++i) {
    ++scene.revision;
    if (i > 0) gpu->LoseForTest();
    ExpectSame(cpu.Run(scene, RigidTransform::Identity(), Lamps()),
               egl.Run(scene, RigidTransform::Identity(), Lamps()), 20'000);
  }
  EXPECT_GT(gpu->generation(), 1u);
}

}  // namespace
}  // namespace mixstage
