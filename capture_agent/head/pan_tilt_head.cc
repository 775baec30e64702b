// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/head/pan_tilt_head.h"

#include <cstdio>

namespace mixstage {
namespace {

Status CheckAngle(const char* name, double angle_deg, double min_deg, double max_deg) {
  if (angle_deg >= min_deg && angle_deg <= max_deg) return {};
  char text[128];
  std::snprintf(text, sizeof text, "%s %g is beyond the head's limits %g .. %g deg", name, angle_deg, min_deg,
                max_deg);
  return Fail(ErrorCode::kBadInput, text);
}

}  // namespace

Status CheckWithin(const HeadLimits& limits, double pan_deg, double tilt_deg) {
  if (auto ok = CheckAngle("pan", pan_deg, limits.pan_min_deg, limits.pan_max_deg); !ok) return ok;
  return CheckAngle("tilt", tilt_deg, limits.tilt_min_deg, limits.tilt_max_deg);
}

}  // namespace mixstage
