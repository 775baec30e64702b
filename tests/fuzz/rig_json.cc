// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "proto/base/check.h"
#include "proto/geometry/rig.h"

// A rig that is accepted has cameras that can be used, and times and ranges that are numbers.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto loaded = ParseRig(std::string(reinterpret_cast<const char*>(data), size));
  if (!loaded) return 0;
  const Rig& rig = loaded->rig;
  MIX_CHECK(rig.color.Validate().has_value());
  (void)rig.color.Unproject({0, 0});
  (void)rig.color.FoldRadiusSquared();
  if (rig.depth) (void)rig.depth->range_error.TrueRange(2.0);
  if (rig.fisheye) (void)rig.fisheye->Unproject({0, 0});
  if (rig.ptu) MIX_CHECK(rig.ptu->T_tilt_color.matrix().allFinite());
  return 0;
}
