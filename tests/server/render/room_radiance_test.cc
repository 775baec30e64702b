// SPDX-License-Identifier: Apache-2.0
#include "server/render/room_radiance.h"

#include <gtest/gtest.h>

#include "server/render/illumination.h"

namespace mixstage {
namespace {

// A cube of 4 m about the origin, seen from inside: its ceiling has another colour than the rest.
RoomModel Cube(cv::Vec3b ceiling, cv::Vec3b rest) {
  RoomModel room;
  room.texture_bgr = cv::Mat3b(8, 16, rest);
  room.texture_bgr(cv::Rect(8, 0, 8, 8)).setTo(cv::Scalar(ceiling[0], ceiling[1], ceiling[2]));
  for (int axis = 0; axis < 3; ++axis) {
    for (const float sign : {-1.0f, 1.0f}) {
      const auto first = static_cast<std::uint32_t>(room.positions.size());
      for (const auto& [s, t] : {std::pair{-2.f, -2.f}, {2.f, -2.f}, {2.f, 2.f}, {-2.f, 2.f}}) {
        Eigen::Vector3f p;
        p[axis] = 2 * sign;
        p[(axis + 1) % 3] = s * -sign;
        p[(axis + 2) % 3] = t;
        room.positions.push_back(p);
        room.uvs.emplace_back(axis == 2 && sign > 0 ? 0.75f : 0.25f, 0.5f);
      }
      room.indices.insert(room.indices.end(), {first, first + 1, first + 2, first, first + 2, first + 3});
    }
  }
  return room;
}

TEST(RoomRadiance, AnEvenRoomShinesEvenly) {
  const RoomRadiance light(Cube({188, 188, 188}, {188, 188, 188}), {});
  const float level = 0.503f;  // sRGB 188
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, 0.5, -1.5)}) {
    const AmbientLight at = light.At(p);
    for (const Eigen::Vector3f& n :
         {Eigen::Vector3f(0, 0, 1), Eigen::Vector3f(1, 0, 0), Eigen::Vector3f(0, -0.6f, 0.8f)})
      EXPECT_NEAR(at.At(n).y(), level, 0.06f * level);
  }
}

TEST(RoomRadiance, ABrightCeilingShinesDown) {
  const RoomRadiance light(Cube({188, 188, 188}, {0, 0, 0}), {});
  const AmbientLight at = light.At({0, 0, 0});
  // From the middle of a cube a face has a form factor of 0.5541 ahead; order 2 keeps it within a few
  // percent.
  EXPECT_NEAR(at.At({0, 0, 1}).x(), 0.5541f * 0.503f, 0.03f);
  EXPECT_NEAR(at.At({0, 0, -1}).x(), 0.0f, 0.03f);
  EXPECT_GT(light.At({0, 0, 1.5}).At({0, 0, 1}).x(), 0.43f) << "and more so near it";
}

TEST(RoomRadiance, WhatIsClippedIsALampAndNotAmbient) {
  const RoomRadiance light(Cube({255, 255, 255}, {0, 0, 0}), {});
  EXPECT_NEAR(light.At({0, 0, 0}).At({0, 0, 1}).x(), 0, 1e-4f);
}

TEST(AmbientLight, TurnsWithItsFrame) {
  AmbientSum sum;
  sum.Add(Eigen::Vector3f(1, 2, 3).normalized(), 2, {1, 0.5f, 0.2f});
  sum.Add(Eigen::Vector3f(-1, 0, 1).normalized(), 1, {0.1f, 0.5f, 0.9f});
  const AmbientLight light = sum.Finish();
  const Eigen::Matrix3f R =
      Eigen::AngleAxisf(0.7f, Eigen::Vector3f(1, -2, 0.5f).normalized()).toRotationMatrix();
  for (const Eigen::Vector3f& n : {Eigen::Vector3f(0, 0, 1), Eigen::Vector3f(0.6f, 0, -0.8f)})
    EXPECT_TRUE(light.Turned(R).At(R * n).isApprox(light.At(n), 1e-4f));
}

TEST(Illumination, TheScenesLightsReplaceTheRoomsTheRoomsTheUsualOnes) {
  RoomLamp lamp;
  lamp.name = "lamp_1";
  lamp.center = {0, 0, 1.9};
  lamp.intensity = 7;
  const RoomRadiance room(Cube({90, 90, 90}, {90, 90, 90}), {lamp});
  Scene scene;
  EXPECT_EQ(IlluminationOf(scene, nullptr).lights.at(0).name, "key");
  const Illumination of_room = IlluminationOf(scene, &room);
  EXPECT_EQ(of_room.lights.at(0).name, "lamp_1");
  EXPECT_EQ(of_room.lights.at(0).intensity, 7);
  scene.lights.push_back({.id = 1, .name = "own", .shape = PointLight{}});
  EXPECT_EQ(IlluminationOf(scene, &room).lights.at(0).name, "own");
  EXPECT_EQ(IlluminationOf(scene, &room).ambient, of_room.ambient) << "the room scatters all the same";
  scene.ambient = Ambient{0.3f, 0.3f};
  EXPECT_NEAR(IlluminationOf(scene, &room).ambient.At({1, 0, 0}).x(), 0.3f, 1e-5f);
}

}  // namespace
}  // namespace mixstage
