// SPDX-License-Identifier: Apache-2.0
#include "server/physics/actor_collider.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/server/physics/test_bodies.h"

namespace mixstage {
namespace {

constexpr double kDistanceM = 2.5;

PinholeCamera Camera() {
  PinholeCamera camera;
  camera.width = 1024, camera.height = 768;
  camera.fx = camera.fy = 1094, camera.cx = 511.5, camera.cy = 383.5;
  return camera;
}

// 1.2 m above the floor, looking along x.
RigidTransform TSceneColor() {
  RigidTransform T = RigidTransform::Identity();
  T.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T.translation() = Eigen::Vector3d(-kDistanceM, 0, 1.2);
  return T;
}

// A fist's front: a square of side_m at (0, y, z) that faces the camera, with the noise of a depth camera.
cv::Mat1f Fist(double y, double z, int frame, double side_m = 0.12, float noise_m = 0.005f) {
  cv::Mat1f depth_m(384, 512, 0.0f);
  const double px = 547 / kDistanceM;
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      const double at_y = -(u - 255.5) / px;
      const double at_z = 1.2 - (v - 191.5) / px;
      if (std::abs(at_y - y) > side_m / 2 || std::abs(at_z - z) > side_m / 2) continue;
      const auto tremble = static_cast<float>((u * 31 + v * 17 + frame * 13) % 21 - 10) / 10;
      depth_m(v, u) = static_cast<float>(kDistanceM) + noise_m * tremble;
    }
  }
  return depth_m;
}

const std::vector<Eigen::AlignedBox3d>& Everywhere() {
  static const std::vector<Eigen::AlignedBox3d> boxes = {
      {Eigen::Vector3d(-2, -2, 0), Eigen::Vector3d(2, 2, 2.5)}};
  return boxes;
}

TEST(ActorCollider, BallsKeepTheirPieceAndHaveItsVelocity) {
  for (const double speed : {0.3, 1.5, 4.0}) {
    ActorCollider collider(Camera());
    std::map<std::uint32_t, Eigen::Vector3d> before;
    double y = -0.9;
    int followed = 0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (int frame = 0; y < 0.9; ++frame) {
      // It starts from rest at 20 m/s^2.
      y += std::min(speed, 20.0 * frame / 30) / 30;
      const auto balls =
          collider.Run(View(Fist(y, 1.2, frame)), TSceneColor(), Everywhere(), 1'000'000 + 33'333 * frame);
      ASSERT_GE(balls.size(), 3u);
      ASSERT_LE(balls.size(), 14u);
      std::map<std::uint32_t, Eigen::Vector3d> now;
      for (const ActorBall& ball : balls) {
        now[ball.id] = ball.center;
        // It lies behind the surface and reaches it.
        EXPECT_NEAR(ball.center.x(), ball.radius_m, 0.03);
        EXPECT_LT(std::abs(ball.center.z() - 1.2), 0.09);
        const auto was = before.find(ball.id);
        if (was == before.end() || frame < 30 * speed / 20 + 8) continue;
        ++followed;
        const Eigen::Vector3d velocity = 30 * (ball.center - was->second);
        sum += velocity;
      }
      before = now;
    }
    ASSERT_GT(followed, 10) << speed;
    // At 4 m/s a fist moves by more than its own width from picture to picture.
    const Eigen::Vector3d mean = sum / followed;
    EXPECT_NEAR(mean.y(), speed, speed > 2 ? 0.3 * speed : 0.1 * speed);
    EXPECT_LT(std::hypot(mean.x(), mean.z()), 0.05 * speed + 0.05);
  }
}

TEST(ActorCollider, WhatIsOutOfReachOrLateMattersNot) {
  ActorCollider collider(Camera());
  const std::vector<Eigen::AlignedBox3d> far = {{Eigen::Vector3d(1, 1, 0), Eigen::Vector3d(1.4, 1.4, 0.4)}};
  EXPECT_TRUE(collider.Run(View(Fist(0, 1.2, 0)), TSceneColor(), far, 0).empty());
  EXPECT_TRUE(collider.Run(View(Fist(0, 1.2, 0)), TSceneColor(), {}, 33'333).empty());
  const auto first = collider.Run(View(Fist(0, 1.2, 0)), TSceneColor(), Everywhere(), 66'666);
  ASSERT_FALSE(first.empty());
  const std::uint32_t last = first.back().id;
  const auto later = collider.Run(View(Fist(0, 1.2, 0)), TSceneColor(), Everywhere(), 1'066'666);
  ASSERT_FALSE(later.empty());
  EXPECT_GT(later.front().id, last) << "after a gap nothing is followed";
}

TEST(ActorCollider, AFistPushesABoxOffATable) {
  Physics physics(SceneFrame::kWorld);
  GridRoom room;
  AddGrid(room, -0.4, 0.4, -0.4, 0.4, 0.75, 8);
  physics.SetRoom(room.positions, room.indices);
  Scene scene;
  scene.objects = {Falling(BoxMesh(0.16f, 0.16f, 0.2f), {0.08, 0.05, 0.87})};
  physics.SetScene(scene);
  ActorCollider collider(Camera());
  bool by_actor = false;
  double lowest = 1e9;
  for (int frame = 0; frame < 150; ++frame) {
    const std::int64_t t_us = 33'333 * frame;
    const double y = -0.7 + 0.8 * std::max(0, frame - 30) / 30.0;
    const auto reach = physics.ActorReach();
    physics.StepTo(t_us, collider.Run(View(Fist(std::min(y, 0.5), 0.86, frame)), TSceneColor(), reach, t_us));
    physics.WritePoses(scene);
    if (frame == 30) {
      EXPECT_NEAR(scene.objects[0].T_scene_object.translation().y(), 0.05, 0.002);
    }
    lowest = std::min(lowest, scene.objects[0].T_scene_object.translation().z());
    for (const PhysicsEvent& event : physics.TakeEvents()) by_actor = by_actor || event.with == "actor";
  }
  EXPECT_TRUE(by_actor);
  EXPECT_LT(lowest, 0.2) << "it did not fall";
  EXPECT_GT(scene.objects[0].T_scene_object.translation().y(), 0.3);
  EXPECT_LT(scene.objects[0].T_scene_object.translation().head<2>().norm(), 1.5) << "it was thrown";
}

TEST(ActorCollider, AFlatHandCarriesABox) {
  Physics physics(SceneFrame::kWorld);
  Scene scene;
  scene.objects = {Falling(BoxMesh(0.1f, 0.1f, 0.1f), {0, 0, 1.06})};
  physics.SetScene(scene);
  // Balls as a hand of 18 x 18 cm has them; it rises, then moves to the side.
  for (int frame = 0; frame < 120; ++frame) {
    std::vector<ActorBall> hand;
    const double rise = 0.3 * std::clamp((frame - 30) / 45.0, 0.0, 1.0);
    const double aside = 0.3 * std::clamp((frame - 75) / 30.0, 0.0, 1.0);
    for (int i = 0; i < 16; ++i)
      hand.push_back({static_cast<std::uint32_t>(i + 1),
                      {0.06 * (i % 4) - 0.09, 0.06 * (i / 4) - 0.09 + aside, 0.96 + rise},
                      0.04});
    physics.StepTo(33'333 * frame, hand);
  }
  physics.WritePoses(scene);
  EXPECT_NEAR(scene.objects[0].T_scene_object.translation().z(), 1.0 + 0.3 + 0.05, 0.02);
  EXPECT_NEAR(scene.objects[0].T_scene_object.translation().y(), 0.3, 0.05);
}

}  // namespace
}  // namespace mixstage
