// SPDX-License-Identifier: Apache-2.0
//
// Where the depth picture's mesh is torn: between actor and wall there is no surface.
#pragma once

#include "server/depth/depth_grid.h"
#include "server/depth/depth_signal.h"
#include "server/depth/surface_noise.h"

namespace mixstage::depth {

struct SurfaceCutConfig {
  float step_sigmas = 4.5f;   // a step is an edge from so many standard deviations of a step on a plane
  float pixel_sigmas = 6.0f;  // a pixel so far from the median around it is flying (mixed) or spurious
};

// Decides on a 3x3 median of the picture (less than half the noise, edges kept) and leaves the geometry to
// the raw one.
//
// An edge between neighbours p, q is cut where the step exceeds the noise by more than the surface's own
// slope explains: that on the flatter side of it or, up to 79 degrees from the ray (floors seen from standing
// height, to 5 m for every metre of height), that on either side. Pixels at a step that mix two surfaces have
// a steep slope on one side only, or a steeper one than surfaces have: they are cut from both and no triangle
// has them.
class SurfaceCut {
 public:
  SurfaceCut(const DepthSignal& signal, const SurfaceCutConfig& config);

  // raw: the sensor's picture; amplitude: same size, or empty. Results stay until the next call.
  void Run(const DepthSignal& signal, ImageView<const std::uint16_t> raw,
           ImageView<const std::uint16_t> amplitude);

  [[nodiscard]] const GridShape& shape() const { return shape_; }
  // z of the depth camera, metres, 0 = none; raw and median.
  [[nodiscard]] const GridPicture<float>& z() const { return z_; }
  [[nodiscard]] const GridPicture<float>& median() const { return median_; }
  // Height of a step that would be cut at a pixel where no slope explains it, metres.
  [[nodiscard]] const GridPicture<float>& step_limit() const { return step_limit_; }
  // 255 where a pixel was measured and is not flying.
  [[nodiscard]] const GridPicture<std::uint8_t>& valid() const { return valid_; }
  // enum Cell; the last column and row are 0.
  [[nodiscard]] const GridPicture<std::uint8_t>& cells() const { return cells_; }
  [[nodiscard]] const SurfaceNoise& noise() const { return meter_.noise(); }
  // Metres between neighbouring rays at 1 m.
  [[nodiscard]] float pitch() const { return pitch_; }

 private:
  void SetLimits(ImageView<const std::uint16_t> amplitude);
  void SetCells();

  GridShape shape_;
  SurfaceCutConfig config_;
  float pitch_ = 0;
  NoiseMeter meter_;
  GridPicture<float> z_, median_, step_limit_, pixel_limit_;
  GridPicture<std::uint8_t> valid_, cut_right_, cut_down_, cells_;
};

}  // namespace mixstage::depth
