// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <stop_token>

#include "capture_agent/head/pan_tilt_head.h"
#include "capture_agent/publisher.h"
#include "capture_agent/sources/source.h"
#include "proto/take/take_recorder.h"

namespace mixstage {

struct AgentTotals {
  std::int64_t captured = 0, published = 0, dropped = 0, unreadable = 0, send_errors = 0;
};

// Runs a source until it ends or `stop`: one thread captures, one publishes, a bounded queue between them; a
// third hears the server's commands, a fourth publishes the head's angles 50 times a second. `head`: what the
// cameras stand on and the server may move; null = it stands still, or its angles come from the source. With
// Pace::kReal a full queue drops its oldest picture, so that capture never waits for the network. `recorder`
// gets all that the source gives, before the network, and obeys the server's commands; null = none.
AgentTotals RunAgent(Source& source, PanTiltHead* head, Pace pace, LcmLink& link,
                     const PublisherConfig& config, TakeRecorder* recorder, std::stop_token stop);

}  // namespace mixstage
