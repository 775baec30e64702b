// SPDX-License-Identifier: Apache-2.0
//
// What happens to the objects of a scene (piVE 4): contacts, and what an author has to know.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

namespace mixstage {

enum class PhysicsEventKind {
  kTouch = 1,  // a free object met another object, the room or the actor
  kRest,       // it has come to rest
  kProblem,    // it cannot fall: text says why
  kMessage,    // what the scene says when they meet (Reactions): text
};
[[nodiscard]] const char* PhysicsEventName(PhysicsEventKind kind);  // "touch", "rest", "problem", "message"

struct PhysicsEvent {
  PhysicsEventKind kind = PhysicsEventKind::kTouch;
  std::int64_t t_us = 0;  // on the clock of the pictures
  std::uint32_t object = 0;
  std::string name{};  // of the object
  // What it met: an object's name and id, "actor", "room", "floor" or the name of a plane of the scan; id 0:
  // no object.
  std::string with{};
  std::uint32_t with_object = 0;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();   // scene frame
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // of length 1, toward the object
  double impulse_ns = 0;                             // N s, of the step in which they met
  std::string text{};                                // of a problem or message: one sentence
};

}  // namespace mixstage
