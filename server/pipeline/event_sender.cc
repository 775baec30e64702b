// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/event_sender.h"

#include "proto/link/epoch.h"
#include "proto/link/fixed_text.h"

namespace mixstage {

EventSender::EventSender() : epoch_(RandomEpoch()) {}

mixstage_lcm::scene_event_t EventSender::Next(const PhysicsEvent& event) {
  mixstage_lcm::scene_event_t m{};
  m.epoch = epoch_;
  m.sequence = sequence_++;
  m.t_us = event.t_us;
  m.kind = static_cast<std::int8_t>(event.kind);
  m.object = static_cast<std::int32_t>(event.object);
  m.with_object = static_cast<std::int32_t>(event.with_object);
  for (int k = 0; k < 3; ++k) {
    m.point[k] = static_cast<float>(event.point[k]);
    m.normal[k] = static_cast<float>(event.normal[k]);
  }
  m.impulse_ns = static_cast<float>(event.impulse_ns);
  WriteFixedText(event.name, m.name);
  WriteFixedText(event.with, m.with);
  WriteFixedText(event.text, m.text);
  return m;
}

}  // namespace mixstage
