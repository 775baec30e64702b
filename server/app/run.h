// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/base/result.h"
#include "server/app/config.h"

namespace mixstage {

// Address, tokens, certificate and the rest of what viewers come in by, without opening anything.
Status CheckDelivery(const StudioConfig& config);

// Everything of a configuration but the network: files are read and checked against each other. What `run`
// does first, and all that --check-config does.
Status CheckShow(const StudioConfig& config);

// Runs the live show until SIGINT or SIGTERM.
Status RunShow(const StudioConfig& config);

}  // namespace mixstage
