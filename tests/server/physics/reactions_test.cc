// SPDX-License-Identifier: Apache-2.0
#include "server/physics/reactions.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/server/physics/test_bodies.h"
#include "tests/server/scene/test_motion.h"

namespace mixstage {
namespace {

constexpr std::int64_t kFrameUs = 33'333;

// A box that falls from a metre onto the floor, and what the scene says to that.
struct Show {
  Physics physics{SceneFrame::kWorld};
  Reactions reactions;
  Animations animations;
  Scene scene, posed;
  std::int64_t t_us = 1'000'000;
  std::vector<PhysicsEvent> messages{};
  int lights_changed = 0;

  explicit Show(std::vector<Reaction> all) {
    scene.objects = {Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 1.1})};
    scene.lights = {Light{.id = 1, .name = "lamp", .shape = PointLight{}, .intensity = 2}};
    scene.reactions = std::move(all);
    Set();
    physics.StepTo(t_us);
  }
  void Set() {
    posed = scene;
    reactions.SetScene(scene, posed);
    physics.SetScene(scene);
  }
  void Run(double seconds) {
    for (int i = 0; i < static_cast<int>(std::lround(30 * seconds)); ++i) {
      t_us += kFrameUs;
      physics.StepTo(t_us);
      physics.WritePoses(posed);
      std::vector<PhysicsEvent> events = physics.TakeEvents();
      lights_changed += reactions.Step(t_us, events, {physics, animations, posed}) ? 1 : 0;
      for (PhysicsEvent& event : events) {
        if (event.kind == PhysicsEventKind::kMessage) messages.push_back(std::move(event));
      }
    }
  }
  [[nodiscard]] double height() const { return posed.objects[0].T_scene_object.translation().z(); }
};

Reaction OnTheFloor(decltype(Reaction::action) action) {
  return {.object = "thing", .meets = "floor", .action = std::move(action)};
}

TEST(Reactions, AMessageIsSaidWhenTheyMeet) {
  Show show({OnTheFloor(SendMessage{"landed"})});
  show.Run(0.4);
  EXPECT_TRUE(show.messages.empty());
  show.Run(0.2);  // 1 m takes 0.45 s
  ASSERT_FALSE(show.messages.empty());
  EXPECT_EQ(show.messages[0].text, "landed");
  EXPECT_EQ(show.messages[0].name, "thing");
  EXPECT_EQ(show.messages[0].with, "floor");
}

TEST(Reactions, ASoftTouchOrAnotherThingIsNoCause) {
  Reaction hard = OnTheFloor(SendMessage{"hard"});
  hard.least_impulse_ns = 100;
  Reaction other = OnTheFloor(SendMessage{"other"});
  other.meets = "actor";
  Show show({hard, other});
  show.Run(2);
  EXPECT_TRUE(show.messages.empty());
}

TEST(Reactions, ItIsPutBackAfterItsTimeAndFallsAgain) {
  Reaction back = OnTheFloor(PutBack{"thing"});
  back.after_s = 1;
  Show show({back, OnTheFloor(SendMessage{"landed"})});
  show.Run(1.4);
  EXPECT_NEAR(show.height(), 0.1, 0.005);
  const std::size_t once = show.messages.size();
  show.Run(0.2);  // the touch came after 0.45 s
  EXPECT_GT(show.height(), 0.9);
  show.Run(0.7);
  EXPECT_NEAR(show.height(), 0.1, 0.02);
  EXPECT_GT(show.messages.size(), once);
}

TEST(Reactions, ALightStaysAsSetUntilAPersonChangesIt) {
  Show show({OnTheFloor(DimLight{"lamp", 0.5f})});
  show.Run(1);
  EXPECT_EQ(show.posed.lights[0].intensity, 0.5f);
  EXPECT_EQ(show.lights_changed, 1);
  show.scene.objects[0].restitution = 0;  // an edit of something else
  show.Set();
  EXPECT_EQ(show.posed.lights[0].intensity, 0.5f);
  show.scene.lights[0].intensity = 3;
  show.Set();
  EXPECT_EQ(show.posed.lights[0].intensity, 3);
}

TEST(Reactions, AnAnimationPlaysWhenTheyMeet) {
  Show show({OnTheFloor(PlayAnimation{"thing", "rise"})});
  show.scene.objects[0].mesh = test::Moving(*show.scene.objects[0].mesh);
  show.scene.objects[0].clip = -1;
  show.Set();
  show.Run(0.4);
  show.animations.Pose(show.t_us, show.posed);
  EXPECT_EQ(show.posed.objects[0].posed, nullptr);
  show.Run(3);
  show.animations.Pose(show.t_us, show.posed);
  ASSERT_NE(show.posed.objects[0].posed, nullptr);
  EXPECT_EQ(show.posed.objects[0].posed->positions[0],
            show.scene.objects[0].mesh->positions[0] + Eigen::Vector3f::UnitZ());
}

TEST(Reactions, WhatIsDueGoesOnThroughEditsAndEndsWithItsReaction) {
  Reaction later = OnTheFloor(SendMessage{"later"});
  later.after_s = 1;
  Show show({later});
  show.Run(0.6);
  show.Set();
  show.Run(0.7);
  EXPECT_EQ(show.messages.size(), 0u);
  show.Run(0.3);
  EXPECT_EQ(show.messages.size(), 1u);

  Show gone({later});
  gone.Run(0.6);
  gone.scene.reactions.clear();
  gone.Set();
  gone.Run(2);
  EXPECT_TRUE(gone.messages.empty());
}

}  // namespace
}  // namespace mixstage
