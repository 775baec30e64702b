// SPDX-License-Identifier: Apache-2.0
//
// From a depth sensor's 16-bit counts to z in metres (MixIn3D 2.1 range correction, 2.2 principle).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "proto/geometry/rig.h"

namespace mixstage {

// Count -> reported range -> true range (systematic error removed) -> z along the axis of the depth camera.
// Phase wrap is not resolved here: a reported range at or beyond the unambiguous one cannot come from the
// sensor and counts as no measurement. Immutable after Create; any thread.
class DepthSignal {
 public:
  // Fails (kInvalidConfig, the field named) when the camera or unit_m is not valid or max_depth_m is not in
  // 0..1000.
  static Result<DepthSignal> Create(const DepthCamera& depth, double max_depth_m);

  // raw    [h x w]  counts, 0 = no measurement
  // z_m    [h x w]  out: metres, 0 = no measurement, no ray (beyond the lens's fold) or farther than
  // max_depth_m Both of the camera's size (checked). Allocates nothing.
  void ToDepth(ImageView<const std::uint16_t> raw, ImageView<float> z_m) const;

  // What a count means, in metres as the sensor measures (range or z); 0 = no measurement.
  [[nodiscard]] float MetresOf(std::uint16_t count) const { return metres_of_count_[count]; }
  // z per metre measured: 1 / |ray| where the sensor measures range, else 1; 0 where a pixel has no ray.
  [[nodiscard]] const cv::Mat1f& z_per_metre() const { return z_per_metre_; }
  // (x/z, y/z) of every pixel of the depth camera, NaN where it has no ray.
  [[nodiscard]] const cv::Mat2f& rays() const { return rays_; }
  [[nodiscard]] int width() const { return rays_.cols; }
  [[nodiscard]] int height() const { return rays_.rows; }

 private:
  DepthSignal() = default;

  std::vector<float> metres_of_count_;  // 65536
  cv::Mat1f z_per_metre_;
  cv::Mat2f rays_;
  float max_depth_m_ = 0;
};

}  // namespace mixstage
