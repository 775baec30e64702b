// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/room_learner.h"

#include <chrono>
#include <utility>

#include "proto/base/log.h"

namespace mixstage {
namespace {

constexpr std::int64_t kSamplePeriodUs = 500'000;
constexpr int kFirstEstimate = 12;       // samples: six seconds
constexpr int kSamplesPerEstimate = 12;  // then again after as many more

}  // namespace

Result<RoomLearner> RoomLearner::Create(int frames, int width, int height) {
  auto still = BackgroundEstimator::Create({.max_samples = frames}, width, height);
  if (!still) return tl::unexpected(still.error());
  auto spread = BackgroundEstimator::Create({}, width, height);
  if (!spread) return tl::unexpected(spread.error());
  return RoomLearner(frames, std::move(*still), std::move(*spread));
}

std::shared_ptr<const BackgroundModel> RoomLearner::Observe(const HalfPicture& picture,
                                                            ImageView<const float> depth_m,
                                                            std::int64_t capture_us) {
  if (state_ == RoomState::kKnown) return nullptr;
  still_.Add(picture, depth_m);
  if (still_.size() >= frames_) {
    // Where a robust model exists, a still set must look like it: somebody who stands still is not the empty
    // set.
    if (still_.IsStill() && (!robust_ || still_.Agrees(*robust_))) return Known(still_.EstimateEmpty());
    still_.Clear();
  }
  if (capture_us >= next_sample_us_) {
    next_sample_us_ = capture_us + kSamplePeriodUs;
    spread_.Add(picture, depth_m);
    ++samples_;
  }
  if (estimating_.valid()) {
    if (estimating_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return nullptr;
    auto model = estimating_.get();
    if (!model) return nullptr;
    robust_ = std::make_shared<const BackgroundModel>(std::move(*model));
    if (state_ == RoomState::kLearning) spdlog::info("room state=estimated samples={}", samples_at_estimate_);
    state_ = RoomState::kEstimated;
    return robust_;
  }
  const int due = robust_ ? samples_at_estimate_ + kSamplesPerEstimate : kFirstEstimate;
  if (samples_ >= due) StartRobustEstimate();
  return nullptr;
}

std::shared_ptr<const BackgroundModel> RoomLearner::Known(Result<BackgroundModel> model) {
  if (!model) return nullptr;
  spdlog::info("room state=known frames={}", still_.size());
  state_ = RoomState::kKnown;
  still_.Clear();
  spread_.Clear();
  return std::make_shared<const BackgroundModel>(std::move(*model));
}

void RoomLearner::StartRobustEstimate() {
  samples_at_estimate_ = samples_;
  // A copy of the samples (their pictures are shared): the estimate runs beside the frames that go on
  // arriving.
  estimating_ = std::async(std::launch::async, [samples = spread_] { return samples.EstimateRobust(); });
}

}  // namespace mixstage
