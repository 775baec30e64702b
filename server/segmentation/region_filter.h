// SPDX-License-Identifier: Apache-2.0
//
// Second half of piVE 3's clean-up: specks and holes, by the evidence that they hold instead of by a median's
// window.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace mixstage {

struct RegionConfig {
  float least_actor_share =
      0.0003f;  // of the picture: regions with less evidence than such a patch of clear actor go
  float largest_hole_share =
      0.004f;  // of the picture: larger holes are background seen through an arm or leg
};

// Labels 4-connected runs, drops actor regions and fills holes (regions of background that do not touch the
// border).
class RegionFilter {
 public:
  // decision [h x w] in/out (actor where > 128): changed pixels are set to the other side, at full strength.
  // evidence [h x w]: what the pixels said before neighbours voted. No allocation in steady state.
  void Run(const cv::Mat1b& evidence, const RegionConfig& config, cv::Mat1b* decision);

 private:
  struct Stretch {  // of one row, all on one side
    int y, begin, end;
    int region;
  };
  struct Region {
    int parent;
    int area;
    float evidence;  // sum over pixels, in log-odds, each limited to +-3; of the room at the border: 0
    bool actor;
    bool border;
  };
  int Find(int region);
  void Unite(int a, int b);
  void LabelRow(const cv::Mat1b& decision, const cv::Mat1b& evidence, int y, std::size_t above_begin);

  std::vector<Stretch> stretches_;
  std::vector<Region> regions_;
};

}  // namespace mixstage
