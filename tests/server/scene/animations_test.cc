// SPDX-License-Identifier: Apache-2.0
#include "server/scene/animations.h"

#include <gtest/gtest.h>

#include "tests/server/scene/test_motion.h"

namespace mixstage {
namespace {

constexpr std::int64_t kSecondUs = 1'000'000, kStartUs = 5 * kSecondUs;

struct Stage {
  Stage() {
    Mesh mesh;
    mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    mesh.normals.assign(3, Eigen::Vector3f::UnitZ());
    mesh.indices = {0, 1, 2};
    const auto moving = test::Moving(mesh);
    for (const std::uint32_t id : {1u, 2u, 3u}) {
      SceneObject object;
      object.id = id;
      object.name = std::to_string(id);
      object.mesh = moving;
      scene.objects.push_back(object);
    }
    scene.objects[1].clip = -1;
    animations.Pose(kStartUs, scene);
  }
  // Where the object's first vertex is so long after the first picture.
  Eigen::Vector3f At(double t_s, std::size_t object = 0) {
    animations.Pose(kStartUs + std::llround(t_s * kSecondUs), scene);
    const SceneObject& of = scene.objects[object];
    return of.posed ? of.posed->positions[0] : of.mesh->positions[0];
  }
  void Play(const std::string& object, const std::string& clip, double t_s) {
    animations.PlayOnce({object, clip}, kStartUs + std::llround(t_s * kSecondUs), scene);
  }

  Scene scene;
  Animations animations;
};

TEST(Animations, AnObjectPlaysItsOwnAgainAndAgain) {
  Stage stage;
  EXPECT_EQ(stage.At(0), Eigen::Vector3f(0, 0, 0));
  EXPECT_EQ(stage.At(0.5), Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(stage.At(2.5), Eigen::Vector3f(1, 0, 0));
  EXPECT_EQ(stage.At(-0.5), Eigen::Vector3f(3, 0, 0)) << "a picture from before the first";
  EXPECT_EQ(stage.At(0.5, 1), Eigen::Vector3f(0, 0, 0)) << "without a clip it stands";
  EXPECT_EQ(stage.scene.objects[0].posed, stage.scene.objects[2].posed) << "both do the same";
  stage.scene.objects[0].clip = 1;
  EXPECT_EQ(stage.At(2.5), Eigen::Vector3f(0, 0, 0.5f));
}

TEST(Animations, OnceAndThenOnWithItsOwn) {
  Stage stage;
  stage.Play("1", "rise", 0.5);
  EXPECT_EQ(stage.At(1), Eigen::Vector3f(0, 0, 0.5f));
  EXPECT_EQ(stage.At(1.75), Eigen::Vector3f(3.5f, 0, 0)) << "as if nothing had been between";
}

TEST(Animations, OnceAndThenStayingWhereItHasNone) {
  Stage stage;
  stage.Play("2", "rise", 1);
  EXPECT_EQ(stage.At(1.5, 1), Eigen::Vector3f(0, 0, 0.5f));
  EXPECT_EQ(stage.At(9, 1), Eigen::Vector3f(0, 0, 1));
  const auto posed = stage.scene.objects[1].posed;
  EXPECT_EQ(stage.At(10, 1), Eigen::Vector3f(0, 0, 1));
  EXPECT_EQ(stage.scene.objects[1].posed, posed) << "what stands is not posed anew";
  stage.Play("2", "rise", 11);  // again from its beginning
  EXPECT_EQ(stage.At(11.25, 1), Eigen::Vector3f(0, 0, 0.25f));
  stage.scene.objects[1].clip = 0;  // a person gives it another
  EXPECT_EQ(stage.At(12.5, 1), Eigen::Vector3f(1, 0, 0));
  stage.scene.objects[1].clip = -1;
  EXPECT_EQ(stage.At(13, 1), Eigen::Vector3f(0, 0, 0));
}

TEST(Animations, WhatIsNotThereIsNotPlayed) {
  Stage stage;
  stage.Play("9", "rise", 0);
  stage.Play("1", "fly", 0);
  EXPECT_EQ(stage.At(0.5), Eigen::Vector3f(1, 0, 0));
  stage.scene.objects[0].hidden = true;
  stage.At(0.75);
  EXPECT_EQ(stage.scene.objects[0].posed, nullptr);
}

}  // namespace
}  // namespace mixstage
