// SPDX-License-Identifier: Apache-2.0
//
// The outline of limbs at about 1.5 m/s, keyed with depth at 12.5 fps that integrates for 80 ms.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "proto/synthetic/figure.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/pipeline/frame_stages.h"

namespace mixstage {
namespace {

constexpr double kDepthPeriod_s = 0.08;  // and its integration time
constexpr int kParts = 5;                // of the integration
constexpr double kWrap_m = 7.5;          // 20 MHz
constexpr double kSlow_m_s = 1.2, kFast_m_s = 1.8;
constexpr int kNear_px = 14;  // of a fast limb's axis

// What the sensor's light adds up to while things move: the sum of the parts' phasors.
DepthPicture Integrate(SyntheticScene& scene, double middle_s, double period_s) {
  DepthPicture picture;
  const double unit_m = scene.rig().depth->unit_m;
  cv::Mat sum, counts, amplitude;
  for (int i = 0; i < kParts; ++i) {
    cv::Mat1w range, light;
    scene.RenderTof(middle_s + period_s * ((i + 0.5) / kParts - 0.5), range, light);
    if (sum.empty()) {
      sum = cv::Mat::zeros(range.size(), CV_64FC2);
      picture.counts = cv::Mat1w(range.size(), std::uint16_t{0});
      picture.amplitude = cv::Mat1w(range.size(), std::uint16_t{0});
    }
    for (int p = 0; p < static_cast<int>(range.total()); ++p) {
      if (range(p) == 0) continue;
      const double phase = 2 * std::numbers::pi * range(p) * unit_m / kWrap_m;
      sum.at<cv::Vec2d>(p) +=
          light(p) / static_cast<double>(kParts) * cv::Vec2d(std::cos(phase), std::sin(phase));
    }
  }
  for (int p = 0; p < static_cast<int>(sum.total()); ++p) {
    const cv::Vec2d s = sum.at<cv::Vec2d>(p);
    const double light = std::hypot(s[0], s[1]);
    if (light < 1) continue;
    double phase = std::atan2(s[1], s[0]);
    if (phase < 0) phase += 2 * std::numbers::pi;
    picture.counts(p) = cv::saturate_cast<std::uint16_t>(phase / (2 * std::numbers::pi) * kWrap_m / unit_m);
    picture.amplitude(p) = cv::saturate_cast<std::uint16_t>(light);
  }
  return picture;
}

// Outline of what is 255, within `where`.
cv::Mat1b Outline(const cv::Mat1b& inside, const cv::Mat1b& where) {
  cv::Mat1b core, around;
  cv::erode(inside, core, cv::getStructuringElement(cv::MORPH_CROSS, {3, 3}));
  cv::erode(where, around, cv::Mat());
  cv::Mat1b outline;
  cv::bitwise_xor(inside, core, outline);
  cv::bitwise_and(outline, around, outline);
  return outline;
}

// Where the figure is, within `where`.
cv::Mat1b TruthWithin(const SyntheticScene& scene, double t_s, const cv::Mat1b& where) {
  cv::Mat1b truth(where.size(), std::uint8_t{0});
  for (int y = 0; y < truth.rows; ++y) {
    for (int x = 0; x < truth.cols; ++x) {
      if (where(y, x) == 0) continue;
      const auto at = scene.TruthAt(SyntheticCamera::kColor, x, y, t_s);
      if (at && at->figure) truth(y, x) = 255;
    }
  }
  return truth;
}

// 255 near what moves at that speed.
cv::Mat1b FastLimbs(const SyntheticScene& scene, double t_s, double tempo) {
  const PinholeCamera& camera = scene.rig().color;
  cv::Mat1b where(camera.height, camera.width, std::uint8_t{0});
  Figure now, then;
  PoseFigure(*scene.FigureState(t_s), now);
  PoseFigure(*scene.FigureState(t_s + 0.01), then);
  const RigidTransform T_color_world = scene.TruthPose().inverse();
  for (int i = 0; i < now.count; ++i) {
    const auto& a = now.parts[static_cast<std::size_t>(i)].cone;
    const auto& b = then.parts[static_cast<std::size_t>(i)].cone;
    for (int k = 0; k <= 8; ++k) {
      const double s = k / 8.0;
      const Eigen::Vector3d p = a.a + a.to_local.inverse() * Eigen::Vector3d(0, 0, s * a.length_m),
                            q = b.a + b.to_local.inverse() * Eigen::Vector3d(0, 0, s * b.length_m);
      const double speed = tempo * (q - p).norm() / 0.01;
      if (speed < kSlow_m_s || speed > kFast_m_s) continue;
      const auto pixel = camera.Project(T_color_world * p);
      if (pixel)
        cv::circle(where, cv::Point(cvRound(pixel->x()), cvRound(pixel->y())), kNear_px, 255, cv::FILLED);
    }
  }
  return where;
}

void Distances(const cv::Mat1b& from, const cv::Mat1b& to, const cv::Mat1b& where,
               std::vector<float>& found) {
  cv::Mat1f distance;
  cv::distanceTransform(to == 0, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  for (int y = 0; y < from.rows; ++y) {
    for (int x = 0; x < from.cols; ++x) {
      if (from(y, x) != 0 && where(y, x) != 0) found.push_back(distance(y, x));
    }
  }
}

// The synthetic set as its cameras see it while the figure plays faster or slower than the clock runs.
class MovingLimb : public testing::Test {
 protected:
  void SetUp() override {
    auto scene = SyntheticScene::Create(SyntheticRig(), {});
    ASSERT_TRUE(scene) << scene.error().message;
    scene_.emplace(std::move(*scene));
    StudioSetup setup;
    setup.rig = SyntheticRig();
    auto studio = Studio::Create(std::move(setup));
    ASSERT_TRUE(studio) << studio.error().message;
    studio_.emplace(std::move(*studio));
    begin_s_ = 0.3;  // nobody is there yet
    for (int i = 0; i < 40 && studio_->room_state() != RoomState::kKnown; ++i) Show();
    ASSERT_EQ(studio_->room_state(), RoomState::kKnown);
  }
  // The play goes on at `begin_s`, `tempo` times as fast.
  void Begin(double begin_s, double tempo) {
    tempo_ = tempo;
    begin_s_ = begin_s - tempo * clock_s_;
  }
  [[nodiscard]] double PlayAt(double clock_s) const { return begin_s_ + tempo_ * clock_s; }
  // The next picture, with the newest depth whose integration is over.
  void Show() {
    clock_s_ += 1 / 30.0;
    auto captured = std::make_shared<CapturedFrame>();
    captured->capture_us = std::llround(clock_s_ * 1e6);
    scene_->RenderColor(PlayAt(clock_s_), captured->color);
    const double middle_s = kDepthPeriod_s * std::floor(clock_s_ / kDepthPeriod_s - 0.5);
    if (!depth_ || depth_->capture_us != std::llround(middle_s * 1e6)) {
      auto depth =
          std::make_shared<DepthPicture>(Integrate(*scene_, PlayAt(middle_s), tempo_ * kDepthPeriod_s));
      depth->capture_us = std::llround(middle_s * 1e6);
      depth_ = std::move(depth);
    }
    captured->depth = depth_;
    frame_.captured = std::move(captured);
    studio_->Run(frame_, times_);
  }
  // Symmetric distances between the outlines of frame_ and of the truth, px, around fast limbs.
  void Compare(std::vector<float>& found) const {
    const double play_s = PlayAt(clock_s_);
    const cv::Mat1b where = FastLimbs(*scene_, play_s, tempo_);
    if (cv::countNonZero(where) == 0) return;
    cv::Mat1b around;
    cv::dilate(where, around, cv::getStructuringElement(cv::MORPH_RECT, {41, 41}));
    const cv::Mat1b truth = Outline(TruthWithin(*scene_, play_s, around), around);
    const cv::Mat1b mine = Outline(cv::Mat1b((frame_.alpha >= 128) & around), around);
    Distances(mine, truth, where, found);
    Distances(truth, mine, where, found);
  }
  void ExpectWithin(double mean_px, double p95_px) {
    std::vector<float> found;
    for (int i = 0; i < kPictures; ++i) {
      Show();
      if (i >= kPictures / 5 && i % 2 == 0) Compare(found);
    }
    ASSERT_GT(found.size(), 500u);
    const double mean = std::accumulate(found.begin(), found.end(), 0.0) / static_cast<double>(found.size());
    std::sort(found.begin(), found.end());
    const double p95 = found[found.size() * 95 / 100];
    RecordProperty("mean_px", std::to_string(mean));
    RecordProperty("p95_px", std::to_string(p95));
    EXPECT_LT(mean, mean_px);
    EXPECT_LT(p95, p95_px);
  }

  static constexpr int kPictures = 30;
  std::optional<SyntheticScene> scene_;
  std::optional<Studio> studio_;
  Frame frame_;

 private:
  double begin_s_ = 0, tempo_ = 1, clock_s_ = 0;
  std::shared_ptr<const DepthPicture> depth_;
  StageTimes times_{0};
};

TEST_F(MovingLimb, LegsThatWalk) {
  Begin(5.0, 1);
  ExpectWithin(3, 10);
}

TEST_F(MovingLimb, AHandThatWaves) {
  Begin(13.0, 1.4);
  ExpectWithin(1.5, 3);
}

}  // namespace
}  // namespace mixstage
