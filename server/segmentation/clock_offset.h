// SPDX-License-Identifier: Apache-2.0
//
// By how much depth's clock differs from the colour camera's (MixIn3D 3.1: two streams of one scene), out of
// the show itself: where depth's outline of a moving actor lies against colour's. At a point of depth's
// outline, measured at t, let s be the distance to colour's outline at that time, v its rate, n its
// direction: an offset T moves the outline by v T, what calibration and depth's mixed pixels are off by does
// not depend on v, so  s = -v T + b + g . n  for all points together, robustly.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <optional>
#include <random>
#include <vector>

#include "proto/base/image_view.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

class ClockOffset {
 public:
  struct Estimate {
    double offset_s = 0;  // to add to depth's times
    double sigma_s = 0;   // from what parts of the show disagree by
  };

  // One keyed colour picture after the other, seen by a camera at rest; a step back in time forgets pictures.
  // mask      [Half(h) x Half(w)]  > 0 actor (Key::half_mask)
  // D         [h x w]  depth as it was measured at depth_us: z in metres, 0 = unknown; empty = none
  // depth_us  by the clock that is to be judged
  void See(const cv::Mat1b& mask, std::int64_t capture_us, ImageView<const float> D, std::int64_t depth_us,
           const BackgroundModel& model);
  // The camera moves or the room is another: pictures are forgotten, not what they have told.
  void Forget();
  // Depth's times are moved by the estimate from now on (not those that See is told): mattes keyed with the
  // wrong ones lean towards them, so what they have told is forgotten, and the estimate is made again.
  void Restart();

  // Nothing until enough moved.
  [[nodiscard]] const std::optional<Estimate>& estimate() const { return estimate_; }

 private:
  struct Picture {
    std::int64_t capture_us = 0;
    cv::Mat1b mask;
  };
  struct Outline {  // of depth, half-size pixels
    std::int64_t depth_us = 0;
    std::vector<cv::Point> points;
  };
  struct Equation {
    float s, v, nx, ny;  // half-size pixels, a second
    int picture;
  };
  void Trace(ImageView<const float> D, std::int64_t depth_us, const BackgroundModel& model);
  void Compare(std::size_t before);
  void Solve();

  std::deque<Picture> pictures_;
  std::optional<Outline> waiting_;  // for the colour pictures round it
  std::int64_t traced_us_ = 0, due_us_ = 0;
  std::vector<Equation> equations_;  // oldest first
  int compared_ = 0;
  bool settled_ = false;  // a look now and then is enough
  std::optional<Estimate> estimate_;
  std::minstd_rand random_{1};
  cv::Mat1f depth_m_;
  cv::Mat1b actor_, known_, edge_;
};

}  // namespace mixstage
