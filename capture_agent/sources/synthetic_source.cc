// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/sources/synthetic_source.h"

#include <algorithm>
#include <array>
#include <utility>

#include "proto/base/clock.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"

namespace mixstage {
namespace {

constexpr std::int64_t kColorPeriodUs = 33'333;
constexpr std::int64_t kDepthPeriodUs = 80'000;
constexpr std::int64_t kHeadPeriodUs = 100'000;
constexpr std::int64_t kDepthPhaseUs = 7'300;  // the cameras are not synchronised, as in a real head
// A picture is rendered as long before its instant as rendering takes, so that it leaves like a camera's.
constexpr std::int64_t kRenderUs = 6'000;
// Later than this, the picture is skipped: a camera does not wait for its computer.
constexpr std::int64_t kTooLateUs = 2 * kColorPeriodUs;

class SyntheticSource final : public Source {
 public:
  SyntheticSource(SyntheticScene scene, Pace pace) : scene_(std::move(scene)), pace_(pace) {
    if (!scene_.rig().depth) next_us_[kDepth] = kNever;
    if (!scene_.rig().ptu) next_us_[kHead] = kNever;
  }

  Result<std::optional<Captured>> Next(std::stop_token stop) override {
    if (start_us_ == 0) start_us_ = MonotonicMicros() + kRenderUs;
    if (amplitude_) {
      // Depth and amplitude are of one exposure: the second follows at once.
      return std::optional(
          Captured{amplitude_us_, Picture(Stream::kAmplitude, *std::exchange(amplitude_, std::nullopt))});
    }
    const auto soonest = std::min_element(next_us_.begin(), next_us_.end());
    const auto what = static_cast<What>(soonest - next_us_.begin());
    const std::int64_t at_us = *soonest;
    Captured captured;
    captured.t_us = start_us_ + at_us;
    if (pace_ == Pace::kReal) {
      if (MonotonicMicros() - captured.t_us > kTooLateUs) Resume();
      if (!WaitUntil(captured.t_us - kRenderUs, stop)) return std::nullopt;
    }
    if (stop.stop_requested()) return std::nullopt;
    *soonest += kPeriodUs[what];
    const double t_s = static_cast<double>(at_us) * 1e-6;
    if (what == kColor) {
      CapturedPicture picture{.stream = Stream::kColor, .content = YuvImage(), .width = 0, .height = 0};
      auto& planes = std::get<YuvImage>(picture.content);
      scene_.RenderColor(t_s, planes);
      picture.width = planes.width();
      picture.height = planes.height();
      captured.what = std::move(picture);
    } else if (what == kDepth) {
      cv::Mat1w range;
      cv::Mat1w amplitude;
      scene_.RenderTof(t_s, range, amplitude);
      amplitude_ = amplitude;
      amplitude_us_ = captured.t_us;
      captured.what = Picture(Stream::kDepth, range);
    } else {
      captured.what = CapturedAngles{0, 0};
    }
    return std::optional(std::move(captured));
  }

 private:
  enum What { kDepth, kColor, kHead, kWhatCount };
  static constexpr std::int64_t kNever = std::int64_t{1} << 60;
  static constexpr std::array<std::int64_t, kWhatCount> kPeriodUs = {kDepthPeriodUs, kColorPeriodUs,
                                                                     kHeadPeriodUs};

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
  const Pace pace_;
  std::int64_t start_us_ = 0;
  std::array<std::int64_t, kWhatCount> next_us_ = {kDepthPhaseUs, 0, 0};
  std::optional<cv::Mat1w> amplitude_;
  std::int64_t amplitude_us_ = 0;
};

}  // namespace

Result<std::unique_ptr<Source>> MakeSyntheticSource(const std::optional<Rig>& rig, Pace pace) {
  auto scene = SyntheticScene::Create(rig.value_or(SyntheticRig()), {});
  if (!scene) return tl::unexpected(scene.error());
  return std::make_unique<SyntheticSource>(std::move(*scene), pace);
}

}  // namespace mixstage
