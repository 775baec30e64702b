// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/room_depth_probe.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/depth/depth_warp.h"
#include "server/segmentation/background_estimator.h"

namespace mixstage {
namespace {

constexpr double kEmpty_s = 0;  // the figure has not come in yet

// The empty synthetic room as the studio learns it: ToF pictures with their noise, warped into the colour
// camera.
struct LearntRoom {
  LearntRoom() : rig(SyntheticRig()), scene(std::move(*SyntheticScene::Create(rig, {}))), probe(rig.color) {
    auto warp = DepthWarp::Create(rig, {});
    auto estimator = BackgroundEstimator::Create({.max_samples = 10}, rig.color.width, rig.color.height);
    YuvImage color;
    HalfPicture half;
    cv::Mat1w range;
    cv::Mat1w amplitude;
    scene.RenderColor(kEmpty_s, color);
    HalfRgb(color, &half);
    for (int i = 0; i < 10; ++i) {
      scene.RenderTof(kEmpty_s + 0.01 * i, range, amplitude);
      cv::Mat1f D(rig.color.height, rig.color.width);
      EXPECT_TRUE(warp->Run(View(std::as_const(range)), View(std::as_const(amplitude)), View(D)));
      estimator->Add(half, View(std::as_const(D)));
    }
    auto model = estimator->EstimateEmpty();
    EXPECT_TRUE(model) << model.error().message;
    room = std::make_shared<const BackgroundModel>(std::move(*model));
    probe.Look(room, scene.TruthPose(), Eigen::Vector3d::UnitZ());
  }
  Rig rig;
  SyntheticScene scene;
  RoomDepthProbe probe;
  std::shared_ptr<const BackgroundModel> room;
};

LearntRoom& Room() {
  static LearntRoom room;  // drawn once: a second
  return room;
}

std::optional<Eigen::Vector3d> TruePoint(LearntRoom& r, double u, double v) {
  const auto truth = r.scene.TruthAt(SyntheticCamera::kColor, u, v, kEmpty_s);
  const auto direction = r.rig.color.Unproject({u, v});
  if (!truth || !direction) return std::nullopt;
  return r.scene.TruthPose() * (truth->depth_m * direction->homogeneous());
}

// 1/z of the true surface; 0 = none.
double InverseDepth(LearntRoom& r, const Eigen::Vector2d& pixel) {
  const auto truth = r.scene.TruthAt(SyntheticCamera::kColor, pixel.x(), pixel.y(), kEmpty_s);
  return truth ? 1 / truth->depth_m : 0;
}

TEST(RoomDepthProbe, ThePointUnderAPixelIsTheRooms) {
  LearntRoom& r = Room();
  ASSERT_FALSE(r.scene.FigureState(kEmpty_s));
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(40, r.rig.color.width - 40);
  std::uniform_real_distribution<double> v(40, r.rig.color.height - 40);
  std::vector<double> errors;
  int asked = 0;
  for (int i = 0; i < 600; ++i) {
    const Eigen::Vector2d pixel(u(random), v(random));
    // Where surfaces end or bend within three pixels of the depth camera, its samples know less: the claim is
    // about surfaces. On a plane 1/z is linear over the picture.
    const auto truth = TruePoint(r, pixel.x(), pixel.y());
    if (!truth) continue;
    const double inverse_z = InverseDepth(r, pixel);
    bool inside = true;
    for (const Eigen::Vector2d& step : {Eigen::Vector2d(20, 0), Eigen::Vector2d(0, 20)}) {
      const double mean = 0.5 * (InverseDepth(r, pixel - step) + InverseDepth(r, pixel + step));
      inside = inside && std::abs(mean / inverse_z - 1) < 0.002;
    }
    if (!inside) continue;
    ++asked;
    const auto point = r.probe.SurfaceUnder(pixel.x(), pixel.y());
    if (point) errors.push_back((*point - *truth).norm());
  }
  ASSERT_GT(asked, 300);
  EXPECT_GT(errors.size(), 0.9 * asked) << "most of the room is known";
  std::sort(errors.begin(), errors.end());
  RecordProperty("median_mm", static_cast<int>(1000 * errors[errors.size() / 2]));
  RecordProperty("p90_mm", static_cast<int>(1000 * errors[errors.size() * 9 / 10]));
  EXPECT_LT(errors[errors.size() / 2], 0.015);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.03);
}

TEST(RoomDepthProbe, ARayGoesThroughTheLensToTheSamePoint) {
  LearntRoom& r = Room();
  for (const auto& [u, v] : {std::pair(20.0, 30.0), {512.5, 384.25}, {1000.0, 740.0}}) {
    const auto ray = r.probe.RayThrough(u, v);
    const auto truth = TruePoint(r, u, v);
    ASSERT_TRUE(ray && truth);
    const Eigen::Vector3d offset = *truth - ray->origin;
    EXPECT_LT(offset.cross(ray->direction.normalized()).norm(), 1e-5);
  }
  EXPECT_FALSE(r.probe.RayThrough(-1, 5));
  EXPECT_FALSE(r.probe.RayThrough(5, 768));
  EXPECT_FALSE(r.probe.SurfaceUnder(5, 1e9));
}

TEST(RoomDepthProbe, ADropRestsOnWhatIsBelow) {
  LearntRoom& r = Room();
  std::vector<bool> floors, tops;  // found within 2 cm
  // Every upright surface that the camera sees and that carries a footprint of 8 cm all around.
  for (double v = 60; v < r.rig.color.height - 20; v += 12) {
    for (double u = 60; u < r.rig.color.width - 60; u += 12) {
      const auto point = TruePoint(r, u, v);
      if (!point) continue;
      bool level = true;
      for (int k = 0; level && k < 12; ++k) {
        const double angle = k * M_PI / 6;
        for (const double radius : {0.05, 0.1, 0.14}) {
          const Ray down{*point + Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0.5),
                         -Eigen::Vector3d::UnitZ()};
          level = level && std::abs(r.scene.room().Trace(down).range_m - 0.5) < 0.003;
        }
      }
      if (!level) continue;
      const auto height = r.probe.HighestSurfaceBelow(*point + Eigen::Vector3d(0, 0, 0.4), 0.08);
      if (!height) continue;  // hardly seen
      const bool right = std::abs(*height - point->z()) < 0.02;
      (point->z() < 0.02 ? floors : tops).push_back(right);
    }
  }
  // A ToF picture shows little of a top seen at a grazing angle, and of a floor close behind furniture.
  ASSERT_GT(floors.size(), 500u);
  ASSERT_GT(tops.size(), 0u) << "furniture";
  EXPECT_GT(std::ranges::count(floors, true), 0.99 * static_cast<double>(floors.size()));
  EXPECT_GT(std::ranges::count(tops, true), 0.5 * static_cast<double>(tops.size()));
}

TEST(RoomDepthProbe, NothingIsKnownWithoutARoom) {
  RoomDepthProbe probe(SyntheticRig().color);
  EXPECT_FALSE(probe.SurfaceUnder(100, 100));
  EXPECT_FALSE(probe.HighestSurfaceBelow({3, 0, 1}, 0.2));
  EXPECT_TRUE(probe.RayThrough(100, 100));
}

}  // namespace
}  // namespace mixstage
