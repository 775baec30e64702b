// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/clock_offset.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr float kInFront = 5.0f;                                  // sigma: depth's actor
constexpr int kRemembered = 8;                                    // colour pictures
constexpr std::int64_t kLongestUs = 160'000;                      // from the picture before to the one after
constexpr std::int64_t kOftenUs = 75'000, kSeldomUs = 1'000'000;  // from one outline to the next
constexpr int kMargin = 24;                                       // half-size pixels round the outlines
constexpr float kReach = 8;      // of a point from colour's outline, half-size pixels
constexpr float kFastest = 800;  // half-size pixels a second
constexpr float kMoves = 60;
constexpr int kLeastPixels = 800;  // of an actor
constexpr std::size_t kPointsOfPicture = 250, kMostEquations = 25'000;
constexpr int kPicturesOfSolution = 8;
constexpr int kParts = 8;
constexpr int kRounds = 8;  // of robust weights
constexpr double kLongestOffset_s = 0.1;
constexpr double kSettled_s = 0.0005;
constexpr double kKnown_s = 0.0015;  // sigma from which the estimate is told

// > 0 inside.
cv::Mat1f SignedDistance(const cv::Mat1b& mask) {
  cv::Mat1f inside, outside;
  cv::Mat1b not_mask;
  cv::distanceTransform(mask, inside, cv::DIST_L2, cv::DIST_MASK_3);
  cv::bitwise_not(mask, not_mask);
  cv::distanceTransform(not_mask, outside, cv::DIST_L2, cv::DIST_MASK_3);
  inside -= outside;
  return inside;
}

float At(const cv::Mat1f& s, cv::Point p) {  // mean of the 2x2 half-size pixels of a quarter-size one
  return 0.25f * (s(p) + s(p.y, p.x + 1) + s(p.y + 1, p.x) + s(p.y + 1, p.x + 1));
}

}  // namespace

void ClockOffset::Forget() {
  pictures_.clear();
  waiting_.reset();
  traced_us_ = due_us_ = 0;
}

void ClockOffset::Restart() {
  equations_.clear();
  compared_ = 0;
  settled_ = false;
}

void ClockOffset::See(const cv::Mat1b& mask, std::int64_t capture_us, ImageView<const float> D,
                      std::int64_t depth_us, const BackgroundModel& model) {
  MIX_CHECK(mask.cols == Half(model.width) && mask.rows == Half(model.height));
  if (!pictures_.empty() &&
      (pictures_.back().capture_us >= capture_us || pictures_.back().mask.size() != mask.size()))
    Forget();
  // The oldest picture's memory is used again.
  Picture picture;
  if (pictures_.size() >= kRemembered) {
    picture = std::move(pictures_.front());
    pictures_.pop_front();
  }
  picture.capture_us = capture_us;
  mask.copyTo(picture.mask);
  pictures_.push_back(std::move(picture));
  if (!waiting_ && !D.empty() && model.has_depth() && depth_us != traced_us_ && capture_us >= due_us_) {
    traced_us_ = depth_us;
    Trace(D, depth_us, model);
    if (waiting_) due_us_ = capture_us + (settled_ ? kSeldomUs : kOftenUs);
  }
  if (!waiting_) return;
  // Between which pictures the outline was measured, by what is known of its clock so far.
  const std::int64_t at_us =
      waiting_->depth_us + (estimate_ ? static_cast<std::int64_t>(estimate_->offset_s * 1e6) : 0);
  if (pictures_.front().capture_us > at_us || capture_us - at_us > 2 * kLongestUs) {
    waiting_.reset();
    return;
  }
  std::size_t nearest = 0;
  for (std::size_t i = 1; i < pictures_.size(); ++i) {
    if (std::abs(pictures_[i].capture_us - at_us) < std::abs(pictures_[nearest].capture_us - at_us))
      nearest = i;
  }
  if (nearest + 1 >= pictures_.size()) return;  // waits for the next
  if (nearest >= 1 && pictures_[nearest + 1].capture_us - pictures_[nearest - 1].capture_us <= kLongestUs)
    Compare(nearest);
  waiting_.reset();
}

void ClockOffset::Trace(ImageView<const float> D, std::int64_t depth_us, const BackgroundModel& model) {
  QuarterDepth(D, &depth_m_);
  actor_.create(depth_m_.size());
  known_.create(depth_m_.size());
  for (int y = 0; y < actor_.rows; ++y) {
    const float* z = depth_m_.ptr<float>(y);
    const float* room = model.room_depth_m.ptr<float>(y);
    const float* sigma = model.sigma_m.ptr<float>(y);
    for (int x = 0; x < actor_.cols; ++x) {
      actor_(y, x) = z[x] > 0 && room[x] > 0 && room[x] - z[x] > kInFront * sigma[x] ? 255 : 0;
      known_(y, x) = room[x] > 0 ? 255 : 0;
    }
  }
  cv::medianBlur(actor_, actor_, 3);
  const cv::Mat cross = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
  cv::erode(actor_, edge_, cross, {-1, -1}, 1, cv::BORDER_CONSTANT, cv::Scalar::all(255));
  cv::subtract(actor_, edge_, edge_);
  // What depth cannot see beside him has no outline.
  cv::erode(known_, known_, cross, {-1, -1}, 2, cv::BORDER_CONSTANT, cv::Scalar::all(0));
  cv::bitwise_and(edge_, known_, edge_);
  Outline outline{depth_us, {}};
  cv::findNonZero(edge_, outline.points);
  if (outline.points.size() < 40) return;
  for (std::size_t i = 0; outline.points.size() > kPointsOfPicture && i < kPointsOfPicture; ++i)
    std::swap(outline.points[i], outline.points[i + random_() % (outline.points.size() - i)]);
  outline.points.resize(std::min(outline.points.size(), kPointsOfPicture));
  for (cv::Point& p : outline.points) p *= 2;
  waiting_ = std::move(outline);
}

void ClockOffset::Compare(std::size_t middle) {
  const Picture& before = pictures_[middle - 1];
  const Picture& now = pictures_[middle];
  const Picture& after = pictures_[middle + 1];
  for (const Picture* picture : {&before, &now, &after}) {
    if (cv::countNonZero(picture->mask) < kLeastPixels) return;
  }
  const cv::Rect whole({0, 0}, now.mask.size());
  cv::Rect box = cv::boundingRect(now.mask);
  box = cv::Rect(box.x - kMargin, box.y - kMargin, box.width + 2 * kMargin, box.height + 2 * kMargin) & whole;
  const cv::Mat1f s_before = SignedDistance(before.mask(box)), s_now = SignedDistance(now.mask(box)),
                  s_after = SignedDistance(after.mask(box));
  const auto between_s = static_cast<float>(static_cast<double>(after.capture_us - before.capture_us) * 1e-6);
  const auto late_s = static_cast<float>(static_cast<double>(waiting_->depth_us - now.capture_us) * 1e-6);
  for (const cv::Point& point : waiting_->points) {
    const cv::Point p = point - box.tl();
    if (p.x < 2 || p.y < 2 || p.x + 3 >= box.width || p.y + 3 >= box.height) continue;
    const float s = At(s_now, p);
    const float v = (At(s_after, p) - At(s_before, p)) / between_s;
    if (std::abs(s) > kReach || std::abs(v) > kFastest) continue;
    const float nx = 0.25f * (At(s_now, p + cv::Point(2, 0)) - At(s_now, p - cv::Point(2, 0)));
    const float ny = 0.25f * (At(s_now, p + cv::Point(0, 2)) - At(s_now, p - cv::Point(0, 2)));
    equations_.push_back({s + v * late_s, v, nx, ny, compared_});
  }
  if (equations_.size() > kMostEquations) {
    equations_.erase(equations_.begin(),
                     equations_.begin() + static_cast<std::ptrdiff_t>(kMostEquations / 4));
  }
  if (++compared_ % kPicturesOfSolution == 0) Solve();
}

// Normal equations of each part of the show, under weights that all of it agreed upon; leaving one part out
// at a time says how far the solution can be trusted.
void ClockOffset::Solve() {
  const auto moving =
      std::ranges::count_if(equations_, [](const Equation& e) { return std::abs(e.v) > kMoves; });
  const int first = equations_.empty() ? 0 : equations_.front().picture;
  const int count = compared_ - first;
  if (moving < 500 || count < 3 * kParts) return;
  Eigen::Vector4d x = Eigen::Vector4d::Zero();
  const auto residual = [&](const Equation& e) {
    return static_cast<double>(e.s) - (-e.v * x[0] + x[1] + e.nx * x[2] + e.ny * x[3]);
  };
  std::vector<float> sizes(equations_.size());
  std::array<Eigen::Matrix4d, kParts> A;
  std::array<Eigen::Vector4d, kParts> b;
  Eigen::Matrix4d A_all;
  Eigen::Vector4d b_all;
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t i = 0; i < sizes.size(); ++i)
      sizes[i] = static_cast<float>(std::abs(residual(equations_[i])));
    auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    const double scale = std::max(1.5 * 1.4826 * static_cast<double>(*middle), 0.1);
    A.fill(Eigen::Matrix4d::Zero());
    b.fill(Eigen::Vector4d::Zero());
    for (const Equation& e : equations_) {
      const double r = residual(e) / scale;
      const double weight = 1 / (1 + r * r);
      const Eigen::Vector4d row(-e.v, 1, e.nx, e.ny);
      const auto part = static_cast<std::size_t>(std::min((e.picture - first) * kParts / count, kParts - 1));
      A[part] += weight * row * row.transpose();
      b[part] += weight * static_cast<double>(e.s) * row;
    }
    A_all.setZero();
    b_all.setZero();
    for (std::size_t i = 0; i < kParts; ++i) A_all += A[i], b_all += b[i];
    x = A_all.ldlt().solve(b_all);
    if (!x.allFinite()) return;
  }
  double sum = 0, squares = 0;
  for (std::size_t i = 0; i < kParts; ++i) {
    const double without = (A_all - A[i]).ldlt().solve(b_all - b[i])[0];
    sum += without;
    squares += without * without;
  }
  const double variance = std::max(squares / kParts - sum * sum / (kParts * kParts), 0.0);
  const double sigma_s = std::sqrt((kParts - 1) * variance);
  if (!std::isfinite(sigma_s) || sigma_s > kKnown_s || std::abs(x[0]) > kLongestOffset_s) return;
  estimate_ = Estimate{x[0], sigma_s};
  settled_ = sigma_s < kSettled_s;
}

}  // namespace mixstage
