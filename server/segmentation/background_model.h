// SPDX-License-Identifier: Apache-2.0
//
// What is known about the empty set as a fixed camera sees it: colour statistics (piVE 3 eq 1-2) and depth of
// the room with its noise (D_M and sigma of MixIn3D 2.4 eq 1). Built by BackgroundEstimator from frames or by
// PredictedBackground from a scan; the key only reads it. Nothing in a model follows the live picture: an
// actor who stands still can never fade into it.
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "server/segmentation/half_picture.h"

namespace mixstage {

[[nodiscard]] constexpr int Quarter(int size) { return Half(Half(size)); }

struct BackgroundModel {
  int width = 0;  // of the full picture, px
  int height = 0;

  // [Half(h) x Half(w)], index 0..2 = R, G, B.
  std::array<cv::Mat1f, 3> mean;      // I_m, piVE eq (1), 0..255
  std::array<cv::Mat1f, 3> variance;  // I_sigma squared, piVE eq (2), with the sensor's noise as floor, > 0
  // ln of the Gaussian's peak over the density of an unknown actor's colour (any colour alike): the log-odds
  // of "actor" for a pixel that equals the room exactly. For the room itself and for the room in shadow.
  cv::Mat1f log_peak_room;
  cv::Mat1f log_peak_shadow;
  cv::Mat1b seen;           // [Half(h) x Half(w)] 0 = never observed: nothing is said; empty = all was seen
  cv::Mat1f mean_luma;      // [Half(h) x Half(w)]
  cv::Mat1f texture_noise;  // [Quarter(h) x Quarter(w)] what noise alone leaves in ShadowTexture's residual

  // [Quarter(h) x Quarter(w)]; empty in a colour-only take.
  cv::Mat1f room_depth_m;  // D_M: z along the colour camera's axis; 0 = not known
  cv::Mat1f sigma_m;       // noise of one measurement of D at this pixel, > 0 where room_depth_m > 0
  cv::Mat1f depth_weight;  // 0..1: falls at steps of the room and where the sensor measures only now and then
  cv::Mat1f log_peak_depth;  // as log_peak_room, for depth

  [[nodiscard]] bool has_depth() const { return !room_depth_m.empty(); }
};

// Samples a full-size depth map [h x w] (z in metres, 0 = none) at the centres of 4x4 blocks. `quarter` is
// allocated where it has another size.
void QuarterDepth(ImageView<const float> depth_m, cv::Mat1f* quarter);

// Raw statistics of the empty set -> model: noise floors, log-odds constants, weights at steps.
struct RoomStatistics {
  int width = 0;  // full picture, px
  int height = 0;
  int sample_count = 0;            // frames that a pixel's statistics come from, typically
  std::array<cv::Mat1f, 3> mean;   // [Half(h) x Half(w)]
  std::array<cv::Mat1f, 3> sigma;  // [Half(h) x Half(w)]
  cv::Mat1f depth_m;               // [Quarter(h) x Quarter(w)] or empty; 0 = not known
  cv::Mat1f depth_sigma_m;         // same size
  cv::Mat1f depth_share;           // same size: share 0..1 of frames in which the room was measured
};
[[nodiscard]] BackgroundModel MakeBackgroundModel(const RoomStatistics& statistics);

// The last steps for both kinds of model. Color: fills what follows from width, height, mean, variance and
// seen. Depth: what follows from room_depth_m and sigma_m; share [Quarter(h) x Quarter(w)] 0..1: how often
// the pixel's room is measured.
void FinishColor(BackgroundModel* model);
void FinishDepth(const cv::Mat1f& share, BackgroundModel* model);

}  // namespace mixstage
