// SPDX-License-Identifier: Apache-2.0
//
// What a scene does when its objects meet something (`reactions` in scene.yaml): a message to viewers and to
// a show-control desk, a light that changes, an object that is put back, an animation that plays.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "server/physics/physics.h"
#include "server/physics/physics_event.h"
#include "server/scene/animations.h"
#include "server/scene/scene.h"

namespace mixstage {

class Reactions {
 public:
  // The scene from now on, in `posed` too, whose lights are set as reactions have left them unless a person
  // has changed them since. What is due goes on where the scene's reactions are the same.
  void SetScene(const Scene& scene, Scene& posed);

  // What reactions change.
  struct Stage {
    Physics& physics;
    Animations& animations;
    Scene& posed;
  };
  // Looks at what has happened and does what is due by t_us of the pictures' clock; messages are appended to
  // the events. A reaction that waits for its time is not set off again. True where a light of `posed` has
  // changed.
  bool Step(std::int64_t t_us, std::vector<PhysicsEvent>& events, const Stage& stage);

 private:
  struct Due {
    std::size_t reaction = 0;
    std::int64_t t_us = 0;
    PhysicsEvent cause;
  };
  struct Dimmed {
    float was = 0, now = 0;
  };
  bool Do(const Due& due, std::vector<PhysicsEvent>& events, const Stage& stage);

  std::vector<Reaction> reactions_;
  std::vector<Due> due_;
  std::map<std::uint32_t, Dimmed> dimmed_;  // by the light's id
  std::vector<SceneObject> objects_;        // where the scene puts them
};

}  // namespace mixstage
