// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "proto/base/check.h"
#include "server/environment/environment.h"

// What is accepted keeps the header's promises, and is accepted again as it is written.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto parsed = ParseEnvironment(std::string(reinterpret_cast<const char*>(data), size));
  if (!parsed) return 0;
  const Environment& e = parsed->environment;
  MIX_CHECK(e.panorama.Validate().has_value());
  MIX_CHECK(e.panorama.Ray(0, 0).allFinite());
  (void)e.panorama.Pixel({1, 2, 3});
  for (const RoomPlane& plane : e.planes) {
    for (const Eigen::Vector3d& corner : plane.polygon) MIX_CHECK(corner.allFinite());
  }
  for (const RoomLamp& lamp : e.lamps) MIX_CHECK(lamp.center.allFinite() && lamp.color.allFinite());
  MIX_CHECK(ParseEnvironment(FormatEnvironment(e)).has_value());
  return 0;
}
