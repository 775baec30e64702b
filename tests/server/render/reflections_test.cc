// SPDX-License-Identifier: Apache-2.0
#include "server/render/reflections.h"

#include <gtest/gtest.h>

#include "server/composite/lay_reflections.h"
#include "server/composite/relight.h"
#include "tests/server/render/test_scenes.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage {
namespace {

// A camera 1 m over a floor looks along it (y points down) at a wall 8 m away; a dark card of 1 m by 1 m
// stands on the floor 4 m away. Light comes evenly from everywhere: the room shines by 1.
constexpr float kHeight_m = 1, kWall_m = 8, kCard_m = 4, kCardColor = 0.25f;
constexpr float kCardShows = kCardColor + 0.04f;  // with the light that any surface mirrors

struct Stage {
  explicit Stage(const RenderDevice& device = {})
      : camera(test::StraightCamera()), reflections(camera, device, std::make_shared<PreparedMeshes>()) {
    scene.frame = SceneFrame::kCamera;
    Mesh card = test::Rectangle(1, 1, 2);
    card.materials[0].base_color.setConstant(kCardColor);
    card.materials[0].double_sided = true;
    scene.objects = {test::Placed(std::move(card), test::At(0, kHeight_m - 0.5, kCard_m))};
    Reflector floor;
    floor.plane = {0, -1, 0, kHeight_m};
    floor.reflectivity = 0.04;
    scene.reflectors = {floor};
    auto created = CgRenderer::Create({}, camera);
    renderer.emplace(std::move(*created));
    mapper.emplace(camera);
    light = test::EvenLight();
    room_depth = cv::Mat1f(camera.height, camera.width);
    for (int y = 0; y < camera.height; ++y) {
      const double down = (y - camera.cy) / camera.fy;
      room_depth.row(y).setTo(down > kHeight_m / kWall_m ? kHeight_m / down : double{kWall_m});
    }
    picture.Create(camera.width, camera.height, ChromaLayout::k420);
    picture.y.setTo(150);
    picture.cb.setTo(128);
    picture.cr.setTo(128);
    alpha = cv::Mat1b(camera.height, camera.width, std::uint8_t{0});
    actor_m = cv::Mat1f(camera.height / 2, camera.width / 2, 0.0f);
  }
  const ReflectionPictures& Run() {
    drawn = scene;
    const auto patches = PatchObjects(scene);
    drawn.objects.insert(drawn.objects.end(), patches.begin(), patches.end());
    const RigidTransform here = RigidTransform::Identity();
    cg = &renderer->Run(drawn, here, light);
    map = &mapper->Run({.scene = &scene, .light = &light, .cg = cg, .room_depth_m = {}, .actor_depth_m = {}});
    return reflections.Run({.scene = &drawn,
                            .first_patch = scene.objects.size(),
                            .light = &light,
                            .cg = cg,
                            .light_map = map,
                            .room_revision = room_revision,
                            .room_depth_m = room_depth,
                            .room_sigma_m = cv::Mat1f(room_depth.size(), 0.001f),
                            .color = &picture,
                            .actor_depth_m = View(std::as_const(actor_m))});
  }
  // The picture with the reflections in it.
  YuvImage Picture() {
    const ReflectionPictures& pictures = Run();
    YuvImage lit;
    RelightPicture(*map, View(std::as_const(alpha)), picture, lit);
    ReflectInPicture(pictures, *map, View(std::as_const(alpha)), lit);
    return lit;
  }
  // In the middle of 2x2 pixels.
  [[nodiscard]] float FresnelAt(int x, int y) const {
    const Eigen::Vector3d ray((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1);
    return Fresnel(scene.reflectors[0].reflectivity, 0, static_cast<float>(ray.y() / ray.norm()));
  }

  PinholeCamera camera;
  Scene scene, drawn;
  Illumination light;
  cv::Mat1f room_depth, actor_m;
  cv::Mat1b alpha;
  YuvImage picture;
  std::uint64_t room_revision = 1;
  const CgLayer* cg = nullptr;
  const LightMap* map = nullptr;
  std::optional<CgRenderer> renderer;
  std::optional<LightMapper> mapper;
  Reflections reflections;
};

// The card stands from row 119.5 to 194.5, its mirror image below it, between columns 122 and 197.
constexpr int kInImage = 216, kMiddle = 160;

int Differing(const cv::Mat1b& a, const cv::Mat1b& b) { return cv::countNonZero(a != b); }

TEST(Reflections, ACardAddsItsLightInPlaceOfTheRooms) {
  Stage stage;
  const ReflectionPictures& pictures = stage.Run();
  ASSERT_EQ(pictures.mirrors.size(), 1u);
  const MirrorPicture& mirror = pictures.mirrors[0];
  const auto at = [&](int x, int y) { return cv::Point(x / 2, y / 2) - mirror.window.tl(); };
  const float expected = stage.FresnelAt(kMiddle, kInImage) * (kCardShows - 1);
  EXPECT_NEAR(mirror.added(at(kMiddle, kInImage))[0], expected, 0.01f * std::abs(expected));
  EXPECT_NEAR(mirror.before(at(kMiddle, kInImage))[0], stage.FresnelAt(kMiddle, kInImage), 1e-4f);
  EXPECT_FLOAT_EQ(mirror.added(at(126, kInImage))[1], mirror.added(at(192, kInImage))[1]);
  EXPECT_EQ(mirror.added(at(118, kInImage))[0], 0.0f);
  EXPECT_EQ(mirror.added(at(202, kInImage))[0], 0.0f);
  EXPECT_EQ(mirror.added(at(kMiddle, 190))[0], 0.0f);  // before its foot
}

TEST(Reflections, OnlyTheMirrorImageChangesThePicture) {
  Stage stage;
  const YuvImage lit = stage.Picture();
  YuvImage shaded;
  RelightPicture(*stage.map, View(std::as_const(stage.alpha)), stage.picture, shaded);
  const cv::Mat1b changed(lit.y != shaded.y);
  EXPECT_EQ(changed(kInImage, kMiddle), 255);
  const cv::Mat1b image = changed(cv::Rect(123, 196, 74, 43));
  EXPECT_EQ(cv::countNonZero(image), static_cast<int>(image.total()));
  EXPECT_LT(cv::countNonZero(changed), static_cast<int>(1.2 * static_cast<double>(image.total())));
}

TEST(Reflections, NothingChangesOutsideThePolygon) {
  Stage stage;
  stage.scene.reflectors[0].polygon = {{-2, 1, 2.0}, {0, 1, 2.0}, {0, 1, 6.0}, {-2, 1, 6.0}};
  const YuvImage lit = stage.Picture();
  EXPECT_NE(lit.y(kInImage, 150), 150);
  EXPECT_EQ(Differing(lit.y(cv::Rect(160, 196, 160, 44)), stage.picture.y(cv::Rect(160, 196, 160, 44))), 0);
}

TEST(Reflections, ARoomWithoutObjectsIsLeftAsItIs) {
  Stage stage;
  stage.scene.objects.clear();
  const YuvImage lit = stage.Picture();
  EXPECT_EQ(Differing(lit.y, stage.picture.y), 0);
  EXPECT_EQ(Differing(lit.cb, stage.picture.cb), 0);
}

TEST(Reflections, WhatStandsBeforeTheSurfaceHidesIt) {
  Stage stage;
  stage.room_depth(cv::Rect(150, 200, 20, 30)).setTo(1.5f);  // a thing of the room
  stage.alpha(cv::Rect(175, 200, 10, 30)).setTo(255);        // the actor's
  const YuvImage lit = stage.Picture();
  EXPECT_NE(lit.y(kInImage, 145), 150);
  EXPECT_EQ(lit.y(kInImage, 160), 150);
  EXPECT_EQ(lit.y(kInImage, 180), 150);
}

TEST(Reflections, TheActorStandsBeforeTheMirroredCard) {
  Stage stage;
  const cv::Point at = cv::Point(kMiddle / 2, 230 / 2);  // a hand above his foot
  const float alone = stage.Run().mirrors[0].added(at - stage.Run().mirrors[0].window.tl())[0];
  // He stands at 3 m, from the floor up: 100 px tall and 100 px wide.
  stage.actor_m(cv::Rect(55, 60, 50, 49)).setTo(3.0f);
  stage.picture.y.setTo(0);
  const ReflectionPictures& with_him = stage.Run();
  const MirrorPicture& mirror = with_him.mirrors[0];
  EXPECT_EQ(mirror.added(at - mirror.window.tl())[0], 0.0f);
  stage.actor_m.setTo(0);
  const ReflectionPictures& gone = stage.Run();
  EXPECT_EQ(gone.mirrors[0].added(at - gone.mirrors[0].window.tl())[0], alone);
}

TEST(Reflections, APatchShowsCardOverActorOverRoom) {
  Stage stage;
  stage.scene.reflectors[0].color = Eigen::Vector3f(0.1f, 0.2f, 0.3f);
  stage.scene.reflectors[0].polygon = {{-3, 1, 2.0}, {3, 1, 2.0}, {3, 1, 7.0}, {-3, 1, 7.0}};
  const auto shows = [&](int x, int y) {
    const ReflectionPictures& pictures = stage.Run();
    CgLayer reflecting;
    EXPECT_TRUE(ReflectInLayer(pictures, *stage.cg, reflecting));
    return reflecting.color(cv::Point(x, y) - reflecting.bounds.tl());
  };
  constexpr int kLow = 230;  // mirrors what is a hand over the floor at his place
  EXPECT_NEAR(shows(60, kLow)[0], 0.1f + stage.FresnelAt(60, kLow), 0.005f);  // the room
  EXPECT_NEAR(shows(kMiddle, kLow)[1], 0.2f + stage.FresnelAt(kMiddle, kLow) * kCardShows, 0.005f);
  EXPECT_EQ(stage.Run().mirrors[0].patch, 2);
  // He wears black.
  stage.actor_m(cv::Rect(10, 60, 100, 49)).setTo(3.0f);
  stage.picture.y.setTo(0);
  EXPECT_NEAR(shows(60, kLow)[0], 0.1f, 0.005f);
}

TEST(Reflections, RoughnessBlursWhatIsFarFromTheSurface) {
  Stage stage;
  stage.scene.reflectors[0].roughness = 0.35;
  const ReflectionPictures& pictures = stage.Run();
  const MirrorPicture& mirror = pictures.mirrors[0];
  // Half-size columns that the card's left edge takes to come up.
  const auto rise = [&](int y) {
    const float whole = mirror.added(cv::Point(kMiddle / 2, y / 2) - mirror.window.tl())[0];
    int between = 0;
    for (int x = 40; x < 80; ++x) {
      const float share = mirror.added(cv::Point(x, y / 2) - mirror.window.tl())[0] / whole;
      between += share > 0.05f && share < 0.95f ? 1 : 0;
    }
    return between;
  };
  EXPECT_LE(rise(198), 3);
  EXPECT_GT(rise(236), rise(198) + 1);
}

TEST(Reflections, NothingIsDrawnWhileNothingChanges) {
  Stage stage;
  const std::uint64_t first = stage.Run().revision;
  EXPECT_EQ(stage.Run().revision, first);
  stage.scene.objects[0].T_scene_object.translation().x() += 0.1;
  EXPECT_NE(stage.Run().revision, first);
}

TEST(Reflections, MirrorsThatFaceEachOtherAndTheCameraEnd) {
  Stage stage;
  Reflector wall;
  wall.plane = {0, 0, -1, 6};
  wall.polygon = {{-2, -1, 6}, {2, -1, 6}, {2, 1, 6}, {-2, 1, 6}};
  wall.color = Eigen::Vector3f::Constant(0.2f);
  wall.reflectivity = 1;
  Reflector ceiling = stage.scene.reflectors[0];
  ceiling.plane = {0, 1, 0, 2};
  Reflector in_camera;
  in_camera.plane = {1, 0, 0, 0};
  stage.scene.reflectors = {stage.scene.reflectors[0], ceiling, wall, wall, in_camera};
  const ReflectionPictures& pictures = stage.Run();
  EXPECT_EQ(pictures.mirrors.size(), 3u);  // floor and the wall twice; no surface of the room is the ceiling
  for (const MirrorPicture& mirror : pictures.mirrors) {
    for (const cv::Vec3f& light : mirror.added) ASSERT_TRUE(std::isfinite(light[0]));
  }
}

TEST(Reflections, BackEndsAgree) {
  MIXSTAGE_SKIP_WITHOUT_EGL();
  Stage cpu, egl({RasterBackend::kEgl, test::SharedGpu()});
  const MirrorPicture a = cpu.Run().mirrors.at(0), b = egl.Run().mirrors.at(0);
  ASSERT_EQ(a.window, b.window);
  EXPECT_LT(cv::norm(a.added, b.added, cv::NORM_L1) / static_cast<double>(a.added.total()), 1e-4);
  EXPECT_LT(cv::norm(a.before, b.before, cv::NORM_INF), 1e-5);
}

}  // namespace
}  // namespace mixstage
