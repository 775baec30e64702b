// SPDX-License-Identifier: Apache-2.0
//
// Tells the rig's network what happens to virtual objects (piVE 4; SPEC.md 2.8).
#pragma once

#include <cstdint>
#include <mixstage_lcm/scene_event_t.hpp>

#include "proto/link/lcm_link.h"
#include "server/physics/physics_event.h"

namespace mixstage {

// One thread at a time.
class EventSender {
 public:
  EventSender();

  // With the next number; texts that are too long are cut.
  [[nodiscard]] mixstage_lcm::scene_event_t Next(const PhysicsEvent& event);
  // A datagram that the socket refuses is lost, and its number with it.
  void Send(const PhysicsEvent& event, LcmLink& link) { link.Publish(Next(event)); }

 private:
  std::int64_t epoch_, sequence_ = 0;
};

}  // namespace mixstage
