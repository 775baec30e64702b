// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "capture_agent/sources/source.h"
#include "proto/take/take.h"

namespace mixstage {

enum class AtEnd {
  kStop = 1,
  kLoop,  // start again; times are carried on, a picture's interval after the last one
};

// Replays a capture folder exactly as a live head would send it: every stream at its own rate and timestamps,
// JPEG bytes unchanged. With Pace::kMax times still advance as recorded.
std::unique_ptr<Source> MakeTakeSource(Take take, Pace pace, AtEnd at_end);

}  // namespace mixstage
