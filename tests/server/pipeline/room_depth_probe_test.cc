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

// Whether what is seen around a pixel, three pixels of the depth camera to each side, is one plane: 1/z of a
// plane is linear over the picture (but for the lens, which is next to nothing over that width).
bool IsOneSurface(LearntRoom& r, double u, double v) {
  const auto inverse = [&](double du, double dv) {
    const auto truth = r.scene.TruthAt(SyntheticCamera::kColor, u + du, v + dv, kEmpty_s);
    return truth ? 1.0 / truth->depth_m : 0.0;
  };
  const double center = inverse(0, 0);
  for (const double reach : {6.0, 12.0, 18.0}) {
    for (const auto& [du, dv] : {std::pair(reach, 0.0), {0.0, reach}, {reach, reach}, {reach, -reach}}) {
      const double bend = inverse(du, dv) + inverse(-du, -dv) - 2 * center;
      if (std::abs(bend) / (center * center) > 0.01) return false;
    }
  }
  return true;
}

TEST(RoomDepthProbe, ThePointUnderAPixelIsTheRooms) {
  LearntRoom& r = Room();
  ASSERT_FALSE(r.scene.FigureState(kEmpty_s));
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(40, r.rig.color.width - 40);
  std::uniform_real_distribution<double> v(40, r.rig.color.height - 40);
  std::vector<double> errors;
  std::size_t asked = 0;
  for (int i = 0; i < 600; ++i) {
    const Eigen::Vector2d pixel(u(random), v(random));
    if (!IsOneSurface(r, pixel.x(), pixel.y())) continue;
    ++asked;
    const auto point = r.probe.SurfaceUnder(pixel.x(), pixel.y());
    if (point) errors.push_back((*point - *TruePoint(r, pixel.x(), pixel.y())).norm());
  }
  ASSERT_GT(asked, 200u);
  EXPECT_GT(errors.size(), asked * 9 / 10) << "most of the room is known";
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.01);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.03);
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

TEST(RoomDepthProbe, ADropOverTheFloorRestsOnIt) {
  LearntRoom& r = Room();
  std::vector<double> errors;
  for (double v = 60; v < r.rig.color.height - 20; v += 12) {
    for (double u = 60; u < r.rig.color.width - 60; u += 12) {
      const auto point = TruePoint(r, u, v);
      if (!point || std::abs(point->z()) > 1e-3) continue;
      bool free = true;  // of furniture, all around
      for (int k = 0; free && k < 24; ++k) {
        const double angle = k % 12 * M_PI / 6;
        const double radius = k < 12 ? 0.08 : 0.14;
        const Ray down{*point + Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0.5),
                       -Eigen::Vector3d::UnitZ()};
        free = std::abs(r.scene.room().Trace(down).range_m - 0.5) < 0.003;
      }
      if (!free) continue;
      const auto height = r.probe.HighestSurfaceBelow(*point + Eigen::Vector3d(0, 0, 0.4), 0.08);
      if (height) errors.push_back(std::abs(*height));
    }
  }
  ASSERT_GT(errors.size(), 1000u);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.005);
  EXPECT_LT(errors[errors.size() * 98 / 100], 0.02) << "the rest lies at the foot of far furniture";
}

// What a camera sees of a floor and a table on it, with a sensor's noise.
std::shared_ptr<const BackgroundModel> TableRoom(const PinholeCamera& camera,
                                                 const RigidTransform& T_world_color,
                                                 const Eigen::AlignedBox3d& table) {
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0, 0.008f);
  BackgroundModel room;
  room.room_depth_m = cv::Mat1f(Quarter(camera.height), Quarter(camera.width), 0.0f);
  room.sigma_m = cv::Mat1f(room.room_depth_m.size(), 0.008f);
  for (int y = 0; y < room.room_depth_m.rows; ++y) {
    for (int x = 0; x < room.room_depth_m.cols; ++x) {
      const auto direction = camera.Unproject({4 * x + 1, 4 * y + 1});
      if (!direction) continue;
      const Eigen::Vector3d from = T_world_color.translation();
      const Eigen::Vector3d along = T_world_color.linear() * direction->homogeneous();  // z = 1
      double z = along.z() < 0 ? -from.z() / along.z() : 0;
      const Eigen::Array3d a = (table.min() - from).array() / along.array();
      const Eigen::Array3d b = (table.max() - from).array() / along.array();
      const double enter = a.min(b).maxCoeff();
      if (enter > 0 && enter <= a.max(b).minCoeff() && enter < z) z = enter;
      if (z > 0 && z < 8) room.room_depth_m(y, x) = static_cast<float>(z) + noise(random);
    }
  }
  return std::make_shared<const BackgroundModel>(room);
}

TEST(RoomDepthProbe, ADropOverATableRestsOnItAndBesideItOnTheFloor) {
  const Rig rig = SyntheticRig();
  const RigidTransform T_world_color = SyntheticTWorldColor(rig);
  const Eigen::Vector3d ahead = T_world_color * Eigen::Vector3d(0, 0, 3.8);
  const Eigen::Vector3d middle(ahead.x(), ahead.y(), 0);
  const Eigen::AlignedBox3d table(middle - Eigen::Vector3d(0.35, 0.5, 0),
                                  middle + Eigen::Vector3d(0.35, 0.5, 0.74));
  RoomDepthProbe probe(rig.color);
  probe.Look(TableRoom(rig.color, T_world_color, table), T_world_color, Eigen::Vector3d::UnitZ());
  const auto below = [&](double x, double y, double z, double radius) {
    return probe.HighestSurfaceBelow(middle + Eigen::Vector3d(x, y, z), radius).value_or(-1);
  };
  EXPECT_NEAR(below(0, 0, 1.2, 0.15), 0.74, 0.01);
  EXPECT_NEAR(below(0, 0.3, 0.75, 0.05), 0.74, 0.01);
  EXPECT_NEAR(below(0, 0, 0.71, 0.15), 0.74, 0.01) << "sunk in a little: lifted";
  EXPECT_NEAR(below(-0.3, 0, 1.2, 0.15), 0.74, 0.01) << "across its edge";
  EXPECT_NEAR(below(-0.55, 0, 1.2, 0.15), 0, 0.01) << "in front of it";
  EXPECT_NEAR(below(-0.51, 0, 1.2, 0.15), 0, 0.01) << "close to its front, which carries nothing";
  EXPECT_NEAR(below(0, -0.9, 1.2, 0.15), 0, 0.01) << "beside it";
  EXPECT_EQ(below(30, 0, 1.2, 0.15), -1) << "never seen";
}

TEST(RoomDepthProbe, NothingIsKnownWithoutARoom) {
  RoomDepthProbe probe(SyntheticRig().color);
  EXPECT_FALSE(probe.SurfaceUnder(100, 100));
  EXPECT_FALSE(probe.HighestSurfaceBelow({3, 0, 1}, 0.2));
  EXPECT_TRUE(probe.RayThrough(100, 100));
}

}  // namespace
}  // namespace mixstage
