// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>

#include "capture_agent/publisher.h"
#include "capture_agent/sources/source.h"

namespace mixstage {

struct AgentTotals {
  std::int64_t captured = 0, published = 0, dropped = 0, unreadable = 0, send_errors = 0;
};

// What the server may ask of the agent beyond parity; called from the thread that hears commands, soon to
// return.
struct AgentHooks {
  std::function<void(bool record)> on_record{};  // start or stop recording; none: the agent does not record
};

// Runs a source until it ends or `stop`: one thread captures, one publishes, a bounded queue between them; a
// third hears the server's commands. With Pace::kReal a full queue drops its oldest picture, so that capture
// never waits for the network.
AgentTotals RunAgent(Source& source, Pace pace, LcmLink& link, const PublisherConfig& config,
                     std::stop_token stop, const AgentHooks& hooks = {});

}  // namespace mixstage
