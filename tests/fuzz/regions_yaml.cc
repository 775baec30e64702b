// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "proto/base/check.h"
#include "server/app/regions_file.h"

// Whatever is understood is a list of bodies whose planes have normals of length 1.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto regions =
      ParseRegions(std::string(reinterpret_cast<const char*>(data), size), "/show/regions.yaml");
  if (!regions) return 0;
  for (const RoomRegion& region : regions->regions) {
    MIX_CHECK(!region.planes.empty());
    for (const Eigen::Vector4d& plane : region.planes)
      MIX_CHECK(plane.allFinite() && std::abs(plane.head<3>().norm() - 1) < 1e-6);
  }
  return 0;
}
