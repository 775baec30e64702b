// SPDX-License-Identifier: Apache-2.0
//
// The depth camera's pictures. A time-of-flight pixel measures the phase of all light that falls on it: the
// room's and the figure's parts of a pixel add up as phasors of length albedo cos / r^2 (mixed pixels at
// outlines), the camera's systematic error is added, then noise that grows as the light falls, then the wrap.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "proto/geometry/rig.h"
#include "proto/synthetic/color_view.h"
#include "proto/synthetic/standing_board.h"

namespace mixstage {

class TofView {
 public:
  // rig.depth must be there (checked).
  TofView(const Room& room, const std::vector<StandingBoard>& boards, const Rig& rig,
          const RigidTransform& T_world_color);

  // range [h x w] counts of rig.depth.unit_m, 0 = no measurement; amplitude [h x w] counts. figure: null =
  // empty set. Allocates nothing once the pictures have their size. One thread at a time.
  void Render(const Figure* figure, std::uint32_t frame, const NoiseTape& tape, SensorNoise noise,
              cv::Mat1w& range, cv::Mat1w& amplitude);

  // Standard deviation of a range by the light that came back (albedo cos / r^2, mean over the pixel).
  [[nodiscard]] static float RangeNoise_m(float light);

 private:
  static constexpr int kRays = 8;  // a pixel

  struct Pixel {
    float reported_m = 0;  // without noise and wrap, systematic error included
    float light = 0;       // albedo cos / r^2
  };
  void TraceRoom(const Room& room, const std::vector<StandingBoard>& boards);
  [[nodiscard]] Pixel Measure(float re, float im, float nearest_turn_m, std::size_t pixel) const;

  DepthCamera camera_;
  RigidTransform T_world_depth_;
  float radians_per_m_ = 0;
  // [pixel][ray]: world direction per metre of depth, its length, the room's phasor.
  std::vector<float> ray_[3], length_, room_re_, room_im_;
  std::vector<float> z_per_range_;   // [pixel] of its central ray
  std::vector<float> room_range_m_;  // [pixel] along the central ray
  std::vector<Pixel> room_;          // [pixel]
  FigureView view_;
};

}  // namespace mixstage
