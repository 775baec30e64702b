// SPDX-License-Identifier: Apache-2.0
//
// The composite's depth, the actor's coverage and the shadow label as the 10-bit planes of the depth stream
// (SPEC.md 4.1, stream 2; proto/watch/depth_code.h has the codes pixel by pixel).
#pragma once

#include <cstdint>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "proto/watch/depth_code.h"
#include "server/delivery/video_encoder.h"

namespace mixstage {

struct DepthRangeConfig {
  double outlier_share = 0.002;  // of the pixels at either end that the range need not hold: 0 .. 0.1
  double margin = 0.08;          // room left at either end for movement until the next fit: 0 .. 1
  float nearest_m = 0.2f;        // near_m never below, far_m never beyond: 0 < nearest_m < farthest_m
  float farthest_m = 50.0f;
};

// near_m and far_m that hold the scene: percentiles of a sample of the picture with a margin. It keeps the
// range it has while that holds the scene and wastes less than a third of its codes: no flicker, few jumps.
class DepthRangeFit {
 public:
  // Fails (kInvalidConfig) on values out of range, by name.
  static Result<DepthRangeFit> Create(const DepthRangeConfig& config);

  // depth_m [h x w] metres, 0 = unknown. Looks at every 8th pixel of every 8th row; a picture in which fewer
  // than 64 of these are known changes nothing. One thread at a time.
  void Update(ImageView<const float> depth_m);
  void Update(ImageView<const std::uint16_t> depth_mm);

  [[nodiscard]] const DepthRange& range() const { return range_; }

 private:
  explicit DepthRangeFit(const DepthRangeConfig& config) : config_(config) {}
  template <typename Pixel>
  void UpdateFrom(ImageView<const Pixel> depth, float unit_m);

  DepthRangeConfig config_;
  DepthRange range_;
  bool fitted_ = false;
  std::vector<float> sample_;  // reused
};

// Fills the planes, allocating only when the size changes. Any thread.
//   depth     [h x w]  metres, or millimetres in 16 bit; 0 (and NaN, negative) = unknown
//   alpha     [h x w]  coverage of the actor, 0..255; an empty view = nowhere
//   label     [h x w]  0 background, 1 actor, 2 shadow, 255 unknown; an empty view = background
// Of 2x2 pixels Cb is the mean coverage, Cr the label of the upper left one (labels have no mean). Views of
// unequal size are a caller bug (checked).
void PackDepth(ImageView<const float> depth_m, ImageView<const std::uint8_t> alpha,
               ImageView<const std::uint8_t> label, const DepthRange& range, Yuv10Image* planes);
void PackDepth(ImageView<const std::uint16_t> depth_mm, ImageView<const std::uint8_t> alpha,
               ImageView<const std::uint8_t> label, const DepthRange& range, Yuv10Image* planes);

}  // namespace mixstage
