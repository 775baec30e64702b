// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/sources/synthetic_source.h"

#include <algorithm>
#include <array>
#include <utility>

#include "proto/base/clock.h"
#include "proto/synthetic/rig.h"

namespace mixstage {
namespace {

constexpr std::int64_t kColorPeriodUs = 33'333;
constexpr std::int64_t kDepthPeriodUs = 80'000;
constexpr std::int64_t kDepthPhaseUs = 7'300;  // the cameras are not synchronised, as in a real head
// A picture is rendered as long before its instant as rendering takes, so that it leaves like a camera's.
constexpr std::int64_t kRenderUs = 6'000;
// Later than this, the picture is skipped: a camera does not wait for its computer.
constexpr std::int64_t kTooLateUs = 2 * kColorPeriodUs;
// A move that ends sooner than the room could be drawn on the way is waited for.
constexpr std::int64_t kViewUs = 1'500'000;

class SyntheticSource final : public Source {
 public:
  SyntheticSource(SyntheticScene scene, const SyntheticHead* head, Pace pace)
      : scene_(std::move(scene)), head_(head), pace_(pace) {
    if (!scene_.rig().depth) next_us_[kDepth] = kNever;
  }

  Result<std::optional<Captured>> Next(std::stop_token stop) override {
    if (start_us_ == 0) start_us_ = MonotonicMicros() + kRenderUs;
    if (amplitude_) {
      // Depth and amplitude are of one exposure: the second follows at once.
      return std::optional(
          Captured{amplitude_us_, Picture(Stream::kAmplitude, *std::exchange(amplitude_, std::nullopt))});
    }
    What what = kColor;
    std::int64_t at_us = 0;
    do {
      const auto soonest = std::min_element(next_us_.begin(), next_us_.end());
      what = static_cast<What>(soonest - next_us_.begin());
      at_us = *soonest;
      if (pace_ == Pace::kReal) {
        if (MonotonicMicros() - (start_us_ + at_us) > kTooLateUs) Resume();
        if (!WaitUntil(start_us_ + at_us - kRenderUs, stop)) return std::nullopt;
      }
      if (stop.stop_requested()) return std::nullopt;
      *soonest = std::max(*soonest, at_us + kPeriodUs[what]);
    } while (!Aim(start_us_ + at_us));
    Captured captured;
    captured.t_us = start_us_ + at_us;
    const double t_s = static_cast<double>(at_us) * 1e-6;
    if (what == kColor) {
      CapturedPicture picture{.stream = Stream::kColor, .content = YuvImage(), .width = 0, .height = 0};
      auto& planes = std::get<YuvImage>(picture.content);
      scene_.RenderColor(t_s, planes);
      picture.width = planes.width();
      picture.height = planes.height();
      captured.what = std::move(picture);
    } else {
      cv::Mat1w range;
      cv::Mat1w amplitude;
      scene_.RenderTof(t_s, range, amplitude);
      amplitude_ = amplitude;
      amplitude_us_ = captured.t_us;
      captured.what = Picture(Stream::kDepth, range);
    }
    return std::optional(std::move(captured));
  }

 private:
  enum What { kDepth, kColor, kWhatCount };
  static constexpr std::int64_t kNever = std::int64_t{1} << 60;
  static constexpr std::array<std::int64_t, kWhatCount> kPeriodUs = {kDepthPeriodUs, kColorPeriodUs};

  // Turns the cameras to where the head is at an instant; false where the picture is better left out.
  bool Aim(std::int64_t t_us) {
    if (head_ == nullptr) return true;
    const std::int64_t left_us = head_->settles_us() - t_us;
    if (left_us > 0 && left_us < kViewUs) return false;
    const HeadReading at = head_->At(t_us);
    scene_.Arrange(at.pan_deg, at.tilt_deg);
    return true;
  }

  static CapturedPicture Picture(Stream stream, const cv::Mat1w& content) {
    return {.stream = stream, .content = content, .width = content.cols, .height = content.rows};
  }
  // After a stall everything goes on from now; what would have been in between was never exposed.
  void Resume() {
    const std::int64_t now_us = MonotonicMicros() - start_us_ + kRenderUs;
    for (int what = 0; what < kWhatCount; ++what) {
      std::int64_t& next_us = next_us_[static_cast<std::size_t>(what)];
      const std::int64_t period_us = kPeriodUs[static_cast<std::size_t>(what)];
      if (next_us != kNever && next_us < now_us)
        next_us += (now_us - next_us + period_us - 1) / period_us * period_us;
    }
  }

  SyntheticScene scene_;
  const SyntheticHead* const head_;
  const Pace pace_;
  std::int64_t start_us_ = 0;
  std::array<std::int64_t, kWhatCount> next_us_ = {kDepthPhaseUs, 0};
  std::optional<cv::Mat1w> amplitude_;
  std::int64_t amplitude_us_ = 0;
};

}  // namespace

Result<std::unique_ptr<Source>> MakeSyntheticSource(const std::optional<Rig>& rig,
                                                    const SyntheticConfig& config, const SyntheticHead* head,
                                                    Pace pace) {
  auto scene = SyntheticScene::Create(rig.value_or(SyntheticRig()), config);
  if (!scene) return tl::unexpected(scene.error());
  return std::make_unique<SyntheticSource>(std::move(*scene), head, pace);
}

}  // namespace mixstage
