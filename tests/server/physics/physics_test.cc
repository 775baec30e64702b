// SPDX-License-Identifier: Apache-2.0
#include "server/physics/physics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "tests/server/physics/test_bodies.h"

namespace mixstage {
namespace {

constexpr std::int64_t kFrameUs = 33'333;

// A show of 30 frames a second.
struct Show {
  Physics physics{SceneFrame::kWorld};
  Scene scene;
  std::int64_t t_us = 1'000'000;
  std::vector<PhysicsEvent> events{};

  explicit Show(std::vector<SceneObject> objects, const GridRoom& room = {}) {
    physics.SetRoom(room.positions, room.indices, {{"table", Eigen::Vector3d::UnitZ(), -0.75, Around()}});
    for (std::size_t i = 0; i < objects.size(); ++i) objects[i].id = static_cast<std::uint32_t>(i + 1);
    scene.objects = std::move(objects);
    physics.SetScene(scene);
    physics.StepTo(t_us);
  }
  static Eigen::AlignedBox3d Around() { return {Eigen::Vector3d(-1, -1, 0.7), Eigen::Vector3d(1, 1, 0.8)}; }
  void Run(double seconds, double from_s = 0) {
    for (int i = 0; i < static_cast<int>(std::lround(30 * seconds)); ++i) Frame(from_s);
  }
  bool Frame(double = 0, std::span<const ActorBall> actor = {}) {
    t_us += kFrameUs;
    physics.StepTo(t_us, actor);
    for (PhysicsEvent& event : physics.TakeEvents()) events.push_back(std::move(event));
    return physics.WritePoses(scene);
  }
  [[nodiscard]] const SceneObject& thing(std::size_t i = 0) const { return scene.objects[i]; }
  [[nodiscard]] long Count(PhysicsEventKind kind, const std::string& with = "") const {
    return std::ranges::count_if(
        events, [&](const PhysicsEvent& e) { return e.kind == kind && (with.empty() || e.with == with); });
  }
};

GridRoom Table() {
  GridRoom room;
  AddGrid(room, -2, 2, -2, 2, 0, 20);
  AddGrid(room, -0.6, 0.6, -0.4, 0.4, 0.75, 12);
  return room;
}

TEST(Physics, FallsByHalfGTSquared) {
  Show show({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 5})});
  show.Run(0.5);
  const double t = 120.0 / kPhysicsStepsPerSecond;
  // Symplectic Euler: n (n + 1) / 2 steps of g dt^2.
  const double fall = 0.5 * 9.81 * t * (t + 1.0 / kPhysicsStepsPerSecond);
  EXPECT_NEAR(show.thing().T_scene_object.translation().z(), 5 - fall, 0.021);  // a step's fall at 4.9 m/s
  EXPECT_NEAR(show.thing().T_scene_object.translation().head<2>().norm(), 0, 1e-6);
}

struct Thing {
  const char* name;
  std::shared_ptr<const Mesh> mesh;
};
const std::vector<Thing>& Things() {
  static const std::vector<Thing> things = {{"box", BoxMesh(0.2f, 0.3f, 0.1f)},
                                            {"small box", BoxMesh(0.03f, 0.03f, 0.03f)},
                                            {"ball", BallMesh(0.11)},
                                            {"vase", VaseMesh()},
                                            {"stool", StoolMesh()},
                                            {"plank", BoxMesh(0.4f, 0.05f, 0.01f)}};
  return things;
}

TEST(Physics, RestsOnTheFloorAndOnATableWithinThreeMillimetres) {
  for (const Thing& thing : Things()) {
    {
      Show show({Falling(thing.mesh, {0.013, 0.021, 1.35})}, Table());
      show.Run(6);
      EXPECT_NEAR(LowestOf(show.thing()), 0.75, 0.0015) << thing.name;
      EXPECT_EQ(show.Count(PhysicsEventKind::kRest), 1) << thing.name;
      EXPECT_GE(show.Count(PhysicsEventKind::kTouch, "table"), 1) << thing.name;
      EXPECT_FALSE(show.Frame()) << thing.name << " still moves";
    }
    Show show({Falling(thing.mesh, {1.5, 0.021, 0.6})}, Table());
    show.Run(6);
    EXPECT_NEAR(LowestOf(show.thing()), 0, 0.0015) << thing.name;
    EXPECT_EQ(show.Count(PhysicsEventKind::kRest), 1) << thing.name;
    EXPECT_GE(show.Count(PhysicsEventKind::kTouch, "floor"), 1) << thing.name;
    EXPECT_FALSE(show.Frame()) << thing.name << " still moves";
  }
}

TEST(Physics, WhatSomebodyBesideItKeepsAwakeIsNotSeenToTremble) {
  Show show({Falling(BallMesh(0.1), {0, 0, 0.86})}, Table());
  show.Run(3);
  int moved = 0;
  for (int i = 0; i < 60; ++i) {
    const ActorBall hand{1, {0.16, 0.001 * (i % 3), 0.85}, 0.05};  // 1 cm beside it
    moved += show.Frame(0, {&hand, 1}) ? 1 : 0;
  }
  EXPECT_EQ(moved, 0);
  EXPECT_EQ(show.Count(PhysicsEventKind::kTouch, "actor"), 0);
}

TEST(Physics, BouncesToRestitutionSquared) {
  for (const double e : {0.0, 0.5, 0.8}) {
    SceneObject ball = Falling(BallMesh(0.1), {0, 0, 1.1});
    ball.restitution = e;
    Show show({ball});
    double top = 0;
    bool landed = false;
    for (int i = 0; i < 60; ++i) {
      show.Frame();
      landed = landed || show.Count(PhysicsEventKind::kTouch, "floor") > 0;
      if (landed) top = std::max(top, show.thing().T_scene_object.translation().z() - 0.1);
      if (show.Count(PhysicsEventKind::kTouch, "floor") > 1) break;
    }
    EXPECT_NEAR(top, e * e, 0.06) << e;
  }
}

TEST(Physics, TheSameShowTwiceIsTheSameBits) {
  const auto run = [] {
    std::vector<SceneObject> objects;
    for (int i = 0; i < 12; ++i)
      objects.push_back(Falling(Things()[static_cast<std::size_t>(i) % Things().size()].mesh,
                                {0.03 * (i % 3), 0.02 * (i % 4), 0.9 + 0.25 * i}));
    Show show(objects, Table());
    show.Run(4);
    std::vector<double> numbers;
    for (const SceneObject& object : show.scene.objects) {
      const auto& m = object.T_scene_object.matrix();
      numbers.insert(numbers.end(), m.data(), m.data() + 16);
    }
    for (const PhysicsEvent& event : show.events) numbers.push_back(event.impulse_ns);
    return numbers;
  };
  EXPECT_EQ(run(), run());
}

TEST(Physics, NothingGoesThroughAThinFloorAtFiveMetresASecond) {
  // A sheet of triangles without thickness at 0.75 m; what falls from 1.3 m above it meets it at 5 m/s.
  for (const Thing& thing : Things()) {
    for (const double shift : {0.0, 0.031, 0.07}) {
      Show show({Falling(thing.mesh, {shift, shift, 0.75 + 1.4})}, Table());
      show.Run(0.8);
      EXPECT_GE(show.Count(PhysicsEventKind::kTouch, "table"), 1) << thing.name;
      EXPECT_EQ(show.Count(PhysicsEventKind::kTouch, "floor"), 0) << thing.name;
    }
  }
}

TEST(Physics, APersonsEditComesBeforePhysics) {
  Show show({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {1.5, 0, 1})});
  show.Run(3);
  EXPECT_NEAR(LowestOf(show.thing()), 0, 0.0015);
  // An edit of something else, with the pose that its author still sees.
  Scene edited = show.scene;
  edited.objects[0].T_scene_object.translation().z() = 1;
  show.physics.SetScene(edited);
  show.Run(0.1);
  EXPECT_NEAR(LowestOf(show.thing()), 0, 0.0015);
  // A drag: it stays where it is put, then falls on.
  for (int i = 1; i <= 10; ++i) {
    edited.objects[0].put = static_cast<std::uint64_t>(1 + i);
    edited.objects[0].T_scene_object.translation().z() = 0.2 * i;
    show.physics.SetScene(edited);
    show.Frame();
    EXPECT_EQ(show.thing().T_scene_object.translation().z(), 0.2 * i);
  }
  show.Run(0.2);
  EXPECT_EQ(show.thing().T_scene_object.translation().z(), 2.0);
  show.Run(3);
  EXPECT_NEAR(LowestOf(show.thing()), 0, 0.0015);
  edited.objects[0].put = 100;
  edited.objects[0].drop = false;
  edited.objects[0].T_scene_object.translation().z() = 0.7;
  show.physics.SetScene(edited);
  show.Run(1);
  EXPECT_EQ(show.scene.objects[0].T_scene_object.translation().z(), 0.7);
}

TEST(Physics, WhoTouchesWhomIsAsInTheScene) {
  for (const Body lower : {Body::kIsolated, Body::kMutual, Body::kActor}) {
    for (const Body upper : {Body::kIsolated, Body::kMutual, Body::kActor}) {
      SceneObject below = Falling(BoxMesh(0.4f, 0.4f, 0.2f), {0, 0, 0.1});
      SceneObject above = Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 0.5});
      below.body = lower;
      above.body = upper;
      above.name = "other";
      Show show({below, above});
      show.Run(2);
      const bool apart = lower == Body::kIsolated || upper == Body::kIsolated;
      EXPECT_NEAR(LowestOf(show.thing(1)), apart ? 0 : 0.2, 0.003);
      EXPECT_EQ(show.Count(PhysicsEventKind::kTouch, "other"), apart ? 0 : 1);
    }
  }
}

TEST(Physics, WhatStandsInTheRoomIsLiftedALittleOrStaysWithAProblem) {
  Show sunken({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 0.06})});
  sunken.Run(2);
  EXPECT_NEAR(LowestOf(sunken.thing()), 0, 0.0015);
  EXPECT_EQ(sunken.Count(PhysicsEventKind::kProblem), 0);
  Show buried({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, -0.05})});
  buried.Run(2);
  EXPECT_EQ(buried.thing().T_scene_object.translation().z(), -0.05);
  EXPECT_EQ(buried.Count(PhysicsEventKind::kProblem), 1);
  EXPECT_EQ(buried.Count(PhysicsEventKind::kTouch), 0);
}

TEST(Physics, SizesThatAreNoneStayWithAProblem) {
  for (const double scale : {1e-4, 1e4}) {
    SceneObject object = Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 1});
    object.T_scene_object.scale(scale);
    Show show({object});
    show.Run(0.5);
    EXPECT_EQ(show.thing().T_scene_object.matrix(), object.T_scene_object.matrix());
    EXPECT_EQ(show.Count(PhysicsEventKind::kProblem), 1);
  }
  // Mirrored, squeezed, sheared, or a sheet of paper: all of these fall.
  Eigen::Matrix3d linear;
  linear << -1, 0.3, 0, 0, 0.5, 0, 0.2, 0, 2;
  SceneObject odd = Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 1});
  odd.T_scene_object.linear() = linear;
  SceneObject sheet = Falling(BoxMesh(0.2f, 0.3f, 0.0f), {1, 0, 1});
  sheet.name = "sheet";
  Show show({odd, sheet});
  show.Run(4);
  EXPECT_NEAR(LowestOf(show.thing(0)), 0, 0.002);
  EXPECT_NEAR(LowestOf(show.thing(1)), 0, 0.0015);
}

TEST(Physics, TimeThatJumpsIsNotCaughtUpWith) {
  Show show({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 3})});
  show.t_us += 3'600'000'000;
  show.Frame();
  EXPECT_GT(show.thing().T_scene_object.translation().z(), 2.5);
  show.t_us -= 7'200'000'000;
  show.Frame();
  EXPECT_GT(show.thing().T_scene_object.translation().z(), 2.5);
  show.Run(2);
  EXPECT_NEAR(LowestOf(show.thing()), 0, 0.0015);
}

// A ball of the actor that moves along x, in a picture every 33 ms.
void Push(Show& show, double speed, double seconds, double x, double z) {
  for (int i = 0; i < static_cast<int>(seconds * 30); ++i) {
    const ActorBall ball{1, {x + speed * i / 30.0, 0.01, z}, 0.04};
    show.Frame(0, {&ball, 1});
  }
}

TEST(Physics, TheActorPushesAndKicksButEjectsNothing) {
  for (const double speed : {0.5, 2.0, 5.0}) {
    Show show({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 0.1})});
    show.Run(1);
    Push(show, speed, 0.5 / speed, -0.4, 0.1);
    EXPECT_GT(show.thing().T_scene_object.translation().x(),
              -0.4 + speed * (std::floor(15 / speed) - 1) / 30 + 0.135)
        << speed;
    EXPECT_GE(show.Count(PhysicsEventKind::kTouch, "actor"), 1) << speed;
    double fastest = 0;
    for (int i = 0; i < 30; ++i) {
      const Eigen::Vector3d before = show.thing().T_scene_object.translation();
      show.Frame();
      fastest = std::max(fastest, 30 * (show.thing().T_scene_object.translation() - before).norm());
    }
    EXPECT_LT(fastest, 1.3 * speed) << "thrown";
  }
  // He appears inside it: nothing happens until he has left.
  Show inside({Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 0.1})});
  inside.Run(1);
  const Eigen::Vector3d before = inside.thing().T_scene_object.translation();
  Push(inside, 0, 0.5, 0.05, 0.1);
  EXPECT_EQ(inside.thing().T_scene_object.translation(), before);
  // One whom he may not touch.
  SceneObject other = Falling(BoxMesh(0.2f, 0.2f, 0.2f), {0, 0, 0.1});
  other.body = Body::kMutual;
  Show untouched({other});
  untouched.Run(1);
  Push(untouched, 1, 0.5, -0.4, 0.1);
  EXPECT_NEAR(untouched.thing().T_scene_object.translation().x(), 0, 1e-4);
}

}  // namespace
}  // namespace mixstage
