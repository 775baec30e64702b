// SPDX-License-Identifier: Apache-2.0
//
// Gravity and touch (MixIn3D 3.1, piVE 4; algorithms 8), by Bullet in fixed steps of 1/240 s. The scanned
// room is a standing surface, the actor a set of small balls that move with him, an object with `drop` a
// rigid body: it falls, rests, is pushed, from wherever a person put it last. Objects without `drop` stand
// where they were put; free ones meet them. Who touches whom: isolated objects the room alone, mutual ones
// the other objects too, actor's ones the actor as well.
//
// The same calls give the same poses, bit for bit. Nothing is allocated for a scene in which nothing falls.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "server/physics/physics_event.h"
#include "server/scene/scene.h"

namespace mixstage {

inline constexpr int kPhysicsStepsPerSecond = 240;

// A ball of the actor; in an ordered list its id names the same piece of him from frame to frame.
struct ActorBall {
  std::uint32_t id = 0;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // scene frame, now
  double radius_m = 0;
};

// A surface that events may name.
struct NamedPlane {
  std::string name;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // of length 1, normal . x + d = 0
  double d = 0;
  Eigen::AlignedBox3d extent;  // where it is
};

// One thread at a time. Scenes and rooms are of the frame that it was made for.
class Physics {
 public:
  explicit Physics(SceneFrame frame);
  ~Physics();
  Physics(const Physics&) = delete;
  Physics& operator=(const Physics&) = delete;

  // The room as a surface of triangles, its visible side counter-clockwise; empty = none. A world scene has
  // its floor at z = 0 beside it, and what of the surface lies within floor_m of that is the floor. All
  // numbers are finite, indices in range (checked). Takes a fifth of a second for 100 thousand triangles.
  void SetRoom(std::span<const Eigen::Vector3f> positions, std::span<const std::uint32_t> indices,
               std::vector<NamedPlane> planes = {}, double floor_m = 0.005);

  // The scene from now on. Free objects go on from where they are, except those that a person has put
  // somewhere since (SceneObject::put): these start there, at rest; one that was free already waits 250 ms
  // for its drag to go on. An object that stands in the room is lifted out of it by up to 5 cm; one that
  // stands deeper in it, or whose size is none, stays where it was put, and a problem says so.
  void SetScene(const Scene& scene);

  // An object of that scene starts again, at rest, where the scene has it.
  void PutBack(const SceneObject& object);

  // Whether anything may move: an object is free and shown.
  [[nodiscard]] bool active() const;
  // Where in the scene the actor matters: boxes about the free objects that he may touch, 0.5 m larger.
  [[nodiscard]] std::vector<Eigen::AlignedBox3d> ActorReach() const;

  // Moves on to t_us of the pictures' clock; the actor's balls go in straight lines from where they were to
  // where they are. A ball that is new does not push what it appears in until it has left it. Time that jumps
  // by more than a quarter of a second, or back, is not caught up with.
  void StepTo(std::int64_t t_us, std::span<const ActorBall> actor = {});

  // Writes T_scene_object of every object that physics moves; `posed` holds the objects of the last SetScene,
  // in their order. True where one has moved since the last call.
  bool WritePoses(Scene& posed);

  // What happened since the last call, at most 256 of a kind of caller's patience: the earliest.
  [[nodiscard]] std::vector<PhysicsEvent> TakeEvents();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace mixstage
