// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <future>
#include <memory>
#include <optional>

#include "server/segmentation/background_estimator.h"

namespace mixstage {

enum class RoomState {
  kLearning = 1,  // nothing to key against yet
  kEstimated,     // a robust estimate: the set was never seen to stand still
  kKnown,         // the empty set was seen: clean plate, or L still frames
};

// Learns the empty set while the show runs (piVE 3): the first L consecutive frames that stand still are
// taken as empty (eq 1-2). Until then, a robust estimate over samples of the last seconds serves, made beside
// the frame thread. Once the empty set is known nothing changes it any more: what never adapts cannot absorb
// a standing actor.
class RoomLearner {
 public:
  // frames: L. width, height: full picture.
  static Result<RoomLearner> Create(int frames, int width, int height);

  // One live frame; sizes as for BackgroundEstimator::Add. depth_m empty = no new depth with this frame.
  // Returns a model when there is a new one.
  std::shared_ptr<const BackgroundModel> Observe(const HalfPicture& picture, ImageView<const float> depth_m,
                                                 std::int64_t capture_us);

  [[nodiscard]] RoomState state() const { return state_; }

 private:
  RoomLearner(int frames, BackgroundEstimator still, BackgroundEstimator spread)
      : frames_(frames), still_(std::move(still)), spread_(std::move(spread)) {}
  std::shared_ptr<const BackgroundModel> Known(Result<BackgroundModel> model);
  void StartRobustEstimate();

  int frames_;
  BackgroundEstimator still_;   // consecutive frames
  BackgroundEstimator spread_;  // two a second
  RoomState state_ = RoomState::kLearning;
  std::shared_ptr<const BackgroundModel> robust_;
  std::future<Result<BackgroundModel>> estimating_;
  std::int64_t next_sample_us_ = 0;
  int samples_at_estimate_ = 0;
  int samples_ = 0;
};

}  // namespace mixstage
