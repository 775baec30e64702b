// SPDX-License-Identifier: Apache-2.0
#include "server/render/light_map.h"

#include <gtest/gtest.h>

#include "tests/server/render/test_scenes.h"
#include "tests/server/scene/test_motion.h"

namespace mixstage {
namespace {

// A camera at the origin of its scene looks along z at a wall 4 m away; a square of 0.4 m hangs 1 m before
// the wall and a lamp stands 2 m before that.
constexpr float kWall_m = 4, kSquare_m = 3, kLamp_m = 1;

struct Stage {
  explicit Stage(std::vector<Light> lights, double offset_m = 0)
      : camera(test::StraightCamera()), mapper(camera) {
    scene.frame = SceneFrame::kCamera;
    scene.objects = {test::Placed(test::Rectangle(0.4f, 0.4f),
                                  Eigen::Affine3d(Eigen::Translation3d(offset_m, 0, kSquare_m)))};
    light.lights = std::move(lights);
    auto created = CgRenderer::Create({}, camera);
    renderer.emplace(std::move(*created));
    room_depth = cv::Mat1f(camera.height, camera.width, kWall_m);
  }
  const LightMap& Run(const cv::Mat1f& actor_depth = {}) {
    const CgLayer& cg = renderer->Run(scene, RigidTransform::Identity(), light);
    return mapper.Run(
        {.scene = &scene,
         .light = &light,
         .cg = &cg,
         .room_revision = 1,
         .room_depth_m = room_depth,
         .actor_depth_m = actor_depth.empty() ? ImageView<const float>() : View(std::as_const(actor_depth))});
  }
  // The factor where the camera sees the point (x, y, z).
  [[nodiscard]] cv::Point PixelOf(double x, double y, double z) const {
    return {static_cast<int>((camera.cx + camera.fx * x / z) / 2),
            static_cast<int>((camera.cy + camera.fy * y / z) / 2)};
  }

  PinholeCamera camera;
  Scene scene;
  Illumination light;
  cv::Mat1f room_depth;
  std::optional<CgRenderer> renderer;
  LightMapper mapper;
};

Light PointAt(double x, float intensity) {
  Light light;
  light.name = "lamp";
  light.shape = PointLight{{x, 0, kLamp_m}};
  light.intensity = intensity;
  return light;
}

TEST(LightMap, AShadowLiesWhereTheLampSeesTheObject) {
  // From x = 0.8 at z = 1 past x = 0 at z = 3 to x = -0.4 at z = 4.
  Stage stage({PointAt(0.8, 3)});
  const LightMap& map = stage.Run();
  ASSERT_GT(cv::countNonZero(map.touched), 0);
  EXPECT_LT(map.room(stage.PixelOf(-0.4, 0, kWall_m))[0], 0.02f);  // no ambient light: black
  EXPECT_GT(map.room(stage.PixelOf(-0.4, 0.5, kWall_m))[0], 0.98f);
  EXPECT_GT(map.room(stage.PixelOf(0.6, 0, kWall_m))[0], 0.98f);
  // Its edge: 0.2 m at 2 m from the lamp are 0.3 m at 3 m.
  EXPECT_LT(map.room(stage.PixelOf(-0.4, 0.27, kWall_m))[0], 0.1f);
  EXPECT_GT(map.room(stage.PixelOf(-0.4, 0.33, kWall_m))[0], 0.9f);
}

TEST(LightMap, AmbientLightAndOtherLampsFillAShadow) {
  Stage stage({PointAt(0.8, 3), PointAt(-0.8, 3)});
  stage.light.ambient = test::EvenAmbient(0.1f);
  const cv::Vec3f s = stage.Run().room(stage.PixelOf(-0.4, 0, kWall_m));
  const auto received = [](double dx) {
    const double d2 = dx * dx + 9;
    return 3 / d2 * 3 / std::sqrt(d2);
  };
  const double other = received(-0.4 + 0.8), hidden = received(-0.4 - 0.8);
  // The square also hides a little of the ambient light.
  EXPECT_NEAR(s[0], (0.1 + other) / (0.1 + other + hidden), 0.01);
}

TEST(LightMap, LargeLampsCastSoftShadowsSmallOnesHard) {
  const auto edge_px = [](float side_m) {
    Light lamp;
    lamp.name = "lamp";
    lamp.shape = AreaLight{{0.8, 0, kLamp_m}, {0, side_m, 0}, {-0.05, 0, 0}};
    lamp.intensity = 200000;
    Stage stage({lamp});
    stage.light.ambient = test::EvenAmbient(0.02f);
    const LightMap& map = stage.Run();
    int px = 0;
    for (double y = 0; y < 1; y += 0.01) {
      const float s = map.room(stage.PixelOf(-0.4, y, kWall_m))[0];
      px += s > 0.25f && s < 0.75f ? 1 : 0;
    }
    return px;
  };
  // Half of the penumbra of a side of 0.6 m: 0.15 m; steps of 0.01 m.
  EXPECT_NEAR(edge_px(0.6f), 15, 6);
  EXPECT_LE(edge_px(0.02f), 3);
}

TEST(LightMap, NothingIsDarkenedTwice) {
  // The actor stands between the lamp and both the square and the wall: where his shadow lies already the
  // camera shows it.
  Stage stage({PointAt(0.8, 3)});
  stage.light.ambient = test::EvenAmbient(0.1f);
  const cv::Point shadow = stage.PixelOf(-0.4, 0, kWall_m);
  EXPECT_LT(stage.Run().room(shadow)[0], 0.6f);
  cv::Mat1f actor(120, 160, 0.0f);
  // At z = 2 the lamp's rays to the shadow pass x = 0.4.
  const cv::Point middle = stage.PixelOf(0.4, 0, 2);
  actor(cv::Rect(middle.x - 24, middle.y - 30, 48, 60) & cv::Rect(0, 0, 160, 120)).setTo(2.0f);
  EXPECT_GT(stage.Run(actor).room(shadow)[0], 0.97f);
  EXPECT_LT(stage.Run().room(shadow)[0], 0.6f) << "and it comes back when he has gone";
}

TEST(LightMap, TheActorShadesTheObjectAndTheObjectTheActor) {
  Stage stage({PointAt(0.8, 3)});
  stage.light.ambient = test::EvenAmbient(0.1f);
  const cv::Point middle = stage.PixelOf(0, 0, kSquare_m);
  EXPECT_GT(stage.Run().cg(middle)[0], 0.98f);
  cv::Mat1f actor(120, 160, 0.0f);
  const cv::Point before = stage.PixelOf(0.4, 0, 2);
  actor(cv::Rect(before.x - 24, before.y - 30, 48, 60) & cv::Rect(0, 0, 160, 120)).setTo(2.0f);
  const std::uint64_t revision = stage.Run().cg_revision;
  const LightMap& shaded = stage.Run(actor);
  EXPECT_LT(shaded.cg(middle)[0], 0.5f);
  EXPECT_NE(shaded.cg_revision, revision);

  actor.setTo(0);
  const cv::Point behind = stage.PixelOf(-0.28, 0, 3.7);  // in the square's shadow
  actor(cv::Rect(behind.x - 12, behind.y - 30, 24, 60)).setTo(3.7f);
  EXPECT_LT(stage.Run(actor).actor(behind)[0], 0.6f);
}

TEST(LightMap, ObjectsThatAreHiddenOrGoneCastNothing) {
  Stage stage({PointAt(0.8, 3)});
  const cv::Point shadow = stage.PixelOf(-0.4, 0, kWall_m);
  EXPECT_LT(stage.Run().room(shadow)[0], 0.1f);
  stage.scene.objects[0].hidden = true;
  ++stage.scene.revision;
  EXPECT_EQ(stage.Run().room(shadow)[0], 1.0f);
  stage.scene.objects.clear();
  ++stage.scene.revision;
  EXPECT_EQ(cv::countNonZero(stage.Run().touched), 0);
}

TEST(LightMap, WhatOneObjectLeavesAloneStaysAndTheRestIsAsIfMadeAnew) {
  const auto with_two = [](double x) {
    Stage stage({PointAt(0.8, 3)}, x);
    stage.light.ambient = test::EvenAmbient(0.1f);
    stage.scene.objects.push_back(test::Placed(test::Rectangle(0.3f, 0.3f),
                                               Eigen::Affine3d(Eigen::Translation3d(-0.9, 0.6, kSquare_m))));
    return stage;
  };
  Stage moved = with_two(0.5);
  moved.Run();
  for (const double x : {0.3, 0.1, -0.1}) {
    moved.scene.objects[0].T_scene_object = Eigen::Translation3d(x, 0, kSquare_m);
    ++moved.scene.revision;
    moved.Run();
  }
  for (int i = 0; i < 20; ++i) moved.Run();  // stands: refined, some squares a frame
  Stage fresh = with_two(-0.1);
  const LightMap& expected = fresh.Run();
  const LightMap& made = moved.Run();
  EXPECT_LT(cv::norm(made.room, expected.room, cv::NORM_INF), 1e-5);
  EXPECT_EQ(cv::norm(made.touched, expected.touched, cv::NORM_INF), 0);
  EXPECT_LT(made.room(moved.PixelOf(-0.53, 0, kWall_m))[0], 0.6f);  // the moved shadow
}

TEST(LightMap, TheShadowOfAnAnimatedObjectGoesWithIt) {
  Stage stage({PointAt(0.8, 3)}, -0.5);
  stage.light.ambient = test::EvenAmbient(0.1f);
  SceneObject& object = stage.scene.objects[0];
  object.mesh = test::Moving(*object.mesh);
  stage.Run();
  for (const float t_s : {0.2f, 0.25f}) {  // 0.5 m to the right
    object.posed = std::make_shared<const PosedVertices>(PoseMesh(*object.mesh->motion, 0, t_s));
    stage.Run();
  }
  for (int i = 0; i < 20; ++i) stage.Run();
  Stage there({PointAt(0.8, 3)}, 0);
  there.light.ambient = test::EvenAmbient(0.1f);
  const LightMap& expected = there.Run();
  const LightMap& made = stage.Run();
  EXPECT_LT(cv::norm(made.room, expected.room, cv::NORM_INF), 2e-3);
  EXPECT_LT(made.room(stage.PixelOf(-0.4, 0, kWall_m))[0], 0.6f);
  EXPECT_LT(cv::norm(made.cg, expected.cg, cv::NORM_INF), 2e-2);
}

TEST(LightMap, TheSunShinesThroughWallsAndCastsParallelShadows) {
  Light sun;
  sun.name = "sun";
  sun.shape = DirectionalLight{Eigen::Vector3d(1, 0, -1).normalized()};
  Stage stage({sun}, 0.5);
  RoomModel box;  // a wall behind the camera, between it and the sun
  box.positions = {{-5, -5, -2}, {5, -5, -2}, {5, 5, -2}, {-5, 5, -2}};
  box.uvs.resize(4, Eigen::Vector2f::Zero());
  box.indices = {0, 1, 2, 0, 2, 3};
  box.texture_bgr = cv::Mat3b(2, 2);
  stage.mapper.SetRoom(box);
  const LightMap& map = stage.Run();
  EXPECT_LT(map.room(stage.PixelOf(-0.5, 0, kWall_m))[0], 0.02f);
  EXPECT_GT(map.room(stage.PixelOf(-0.5, 0.25, kWall_m))[0], 0.98f);
}

}  // namespace
}  // namespace mixstage
