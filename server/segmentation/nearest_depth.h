// SPDX-License-Identifier: Apache-2.0
//
// What a depth camera left out (the strip at silhouettes, dark hair) taken to be as far away as what is known
// beside: half of a strip belongs to each side of it.
#pragma once

#include <opencv2/core.hpp>

namespace mixstage {

// depth_m      [h x w]  z in metres, <= 0 = not known
// nearest_m    [h x w]  out: that of the nearest pixel that is known, its own where it is
// distance_px  [h x w]  out: how far away that is
// False where nothing is known: then the outputs are left as they are.
[[nodiscard]] bool FindNearestDepth(const cv::Mat1f& depth_m, cv::Mat1f* nearest_m, cv::Mat1f* distance_px);

}  // namespace mixstage
