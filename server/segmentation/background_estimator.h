// SPDX-License-Identifier: Apache-2.0
//
// Learns the empty set of a fixed camera from sample frames (piVE 3 eq 1-2; without empty frames: a robust
// estimate over the take). Feed a clean plate, the first frames, or frames spread over the take (live: about
// two a second), then ask for a model. One thread at a time; may run beside the key, whose model is a
// separate value.
#pragma once

#include <vector>

#include "proto/base/result.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

struct BackgroundEstimatorConfig {
  int max_samples = 40;        // 1..120: bounds memory (about 0.8 MB each at 1024x768); piVE's L is 30
  float empty_share = 0.004f;  // a set is still while less than this share of its pixels leaves the noise
  // Robust estimate: the farthest depth seen in this share of the samples is the room. Half is the median's
  // meaning: what a thing that was put down hides for most of the take is no longer the room.
  float far_share = 0.5f;
};

class BackgroundEstimator {
 public:
  // width, height: full picture, px. Fails with kInvalidConfig where a value is out of its range.
  static Result<BackgroundEstimator> Create(const BackgroundEstimatorConfig& config, int width, int height);

  // picture [Half(h) x Half(w)]; depth_m [h x w] z in metres, 0 = none, or empty = this frame has none. When
  // the store is full every second sample is dropped and from then on every second Add is ignored: the
  // samples stay spread over all that was seen.
  void Add(const HalfPicture& picture, ImageView<const float> depth_m);
  [[nodiscard]] int size() const { return static_cast<int>(samples_.size()); }
  void Clear();

  // True where the samples show one still set: after one tone change per sample, nothing larger than noise
  // moved. Says nothing about whether somebody sits in it: compare with Agrees().
  [[nodiscard]] bool IsStill() const;
  // True where a still set of samples shows the same picture as `model` (for instance the robust model of the
  // whole take): then the frames are empty, and their plain statistics are the better ones.
  [[nodiscard]] bool Agrees(const BackgroundModel& model) const;

  // piVE eq (1)-(2) over all samples, known to be empty. kUnavailable without samples.
  [[nodiscard]] Result<BackgroundModel> EstimateEmpty() const;
  // Samples with actors in them: the farthest depth that keeps coming back is the room, the most frequent
  // colour among the samples that show it is its picture. kUnavailable below 3 samples.
  [[nodiscard]] Result<BackgroundModel> EstimateRobust() const;

  struct Sample {
    HalfPicture picture;  // owned
    cv::Mat1f depth_m;    // [Quarter(h) x Quarter(w)], empty = none
  };

 private:
  BackgroundEstimator(const BackgroundEstimatorConfig& config, int width, int height)
      : config_(config), width_(width), height_(height) {}

  BackgroundEstimatorConfig config_;
  int width_ = 0;
  int height_ = 0;
  int stride_ = 1;  // every stride-th Add is kept
  int skipped_ = 0;
  std::vector<Sample> samples_;
};

}  // namespace mixstage
