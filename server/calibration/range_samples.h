// SPDX-License-Identifier: Apache-2.0
//
// What a ToF camera said about boards whose place is known: per pixel the range measured, the range to the
// board's plane along the pixel's ray, and the amplitude.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "server/calibration/board_scene.h"

namespace mixstage {

struct RangeSample {
  double range_m = 0;     // to the board's plane, along the ray
  double measured_m = 0;  // as reported, unwrapped to within half the unambiguous range of range_m
  double amplitude = 0;   // counts; 1 where there is no amplitude picture
  std::size_t view = 0;   // which call they came from, for holding views out
};

struct RangePictureScale {
  double unit_m = 0.001;                      // metres per count
  std::optional<double> unambiguous_range_m;  // nothing = no wrap
  bool measures_z = false;                    // z along the axis instead of range: turned into range
};

// Appends the pixels that lie on the board at least 2.5 px inside its outline (flying pixels mix what is
// behind). range [h x w] counts, 0 = no measurement; amplitude of the same size or empty.
void AppendRangeSamples(const Lens& lens, const RigidTransform& T_camera_board, const Board& board,
                        const cv::Mat1w& range, const cv::Mat1w& amplitude, const RangePictureScale& scale,
                        std::size_t view, std::vector<RangeSample>& samples);

}  // namespace mixstage
