// SPDX-License-Identifier: Apache-2.0
//
// The range picture of one position of the head, out of the depth frames taken there (MixIn3D 2.1 range
// correction; algorithms 3): its noise measured in the frames themselves, frames averaged, the phase's wraps
// resolved, mixed pixels at silhouettes left out.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "proto/geometry/rig.h"

namespace mixstage {

// The depth camera of a rig as the scan sees it: where its pixels look, what its counts mean.
struct RangeCamera {
  cv::Mat3f ray;        // [h x w] unit vectors in the depth camera's frame; NaN where a pixel has none
  float pitch_rad = 0;  // between neighbouring pixels, in the middle of the picture
  RigidTransform T_color_depth = RigidTransform::Identity();
  DepthMeasure measures = DepthMeasure::kRange;
  double unit_m = 0.001;
  float wrap_m = 0;  // reported ranges are modulo this; 0 = no wrap
  RangeError range_error;

  // The rig has a depth camera (checked).
  static RangeCamera Of(const Rig& rig);
};

// The frames of one position as the sensor gave them; amplitudes one each or none.
struct RangeFrames {
  std::vector<cv::Mat1w> counts;
  std::vector<cv::Mat1w> amplitudes;
};

// Standard deviation of one frame's range. With amplitude sqrt(c0 + c1 A) / A (algorithms 3), otherwise
// c0 + c1 r^2. Measured in differences of a position's frames, where it has only one in second differences of
// neighbouring pixels.
struct RangeNoise {
  bool by_amplitude = false;
  double c0 = 0, c1 = 0;
  double most_m = 1;  // a phase that is pure noise

  static RangeNoise Measure(const std::vector<RangeFrames>& views, const RangeCamera& camera);
  [[nodiscard]] float Sigma(float amplitude, float range_m) const;
};

struct RangeView {
  cv::Mat1f range_m;  // [h x w] along the ray, systematic error removed; 0 = not known
  cv::Mat1f sigma_m;  // [h x w] standard deviation of it
  int moved_px = 0;   // pixels whose frames contradict each other: something moved
};

// Averages the frames, resolves wraps, corrects the range, removes mixed pixels.
// typical_return: median of amplitude x range^2 of the sweep (TypicalReturn); 0 without amplitude.
RangeView MakeRangeView(const RangeFrames& frames, const RangeCamera& camera, const RangeNoise& noise,
                        double typical_return);

// The light a surface of the sweep typically returns, amplitude x range^2, taking ranges as not wrapped; 0
// without amplitude.
double TypicalReturn(const std::vector<RangeFrames>& views, const RangeCamera& camera);

// Adds whole wraps to range_m [h x w] (0 = not known): neighbours that are one surface modulo wrap_m stay
// one; each such surface takes the number of wraps whose amplitude x range^2 is nearest to what is typical.
// amplitude may be empty: then no more than continuity is known.
void ResolveWraps(cv::Mat1f& range_m, const cv::Mat1f& sigma_m, const cv::Mat1f& amplitude, float wrap_m,
                  double typical_return);

// Sets pixels to 0 whose range lies between two surfaces at a step (algorithms 3, mixed pixels).
void RemoveMixedPixels(cv::Mat1f& range_m, const cv::Mat1f& sigma_m);

}  // namespace mixstage
