// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/environment/environment_folder.h"
#include "server/environment/panorama.h"

namespace mixstage {

// A texture that is the panorama lies straight on a surface only while triangles are small: along an edge its
// coordinates are no linear function of the place. Splits edges until they are off by half a texel at most;
// both triangles of an edge are split alike, so that no gap opens. Edges whose ends are not where the
// panorama has them (another texture) stay; so does everything once kMostSplitTriangles are reached.
inline constexpr std::size_t kMostSplitTriangles = 400'000;
void SplitForPanorama(const Panorama& panorama, RoomModel& room);

}  // namespace mixstage
