// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/camera_nudge.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "server/environment/room_prediction.h"

namespace mixstage {
namespace {

constexpr int kLooks = 4;           // that agree
constexpr double kAgree_px = 1.0;   // full pixels
constexpr double kLeast_px = 1.5;   // less is within what the key's own noise bears
constexpr double kMostShare = 0.1;  // of the picture's width: farther is another view, not a nudge
constexpr double kClear = 0.2;      // share of the correlation that lies in its peak
// What is not known of the shift, squared half-size pixels, on the room's contrast.
constexpr float kDoubt = 0.04f;
constexpr float kUnknownVariance = 1e5f;  // any colour is as good as any other

cv::Size QuarterSize(const BackgroundModel& room) { return {Quarter(room.width), Quarter(room.height)}; }

void Move(const cv::Mat& from, const cv::Point2d& shift, int how, cv::Mat& to) {
  const cv::Matx23d by(1, 0, shift.x, 0, 1, shift.y);
  cv::warpAffine(from, to, by, from.size(), how, cv::BORDER_REPLICATE);
}

}  // namespace

std::optional<cv::Point2d> CameraNudge::See(const HalfPicture& picture, const BackgroundModel& room) {
  if (++pictures_ % kEvery != 0) return std::nullopt;
  MIX_CHECK(picture.g.size() == room.mean_luma.size());
  const cv::Size size = QuarterSize(room);
  if (size.width < 16 || size.height < 16) return std::nullopt;
  cv::Mat1b small;
  cv::resize(picture.g, small, size, 0, 0, cv::INTER_AREA);
  small.convertTo(now_, CV_32F);
  cv::resize(room.mean[1], then_, size, 0, 0, cv::INTER_AREA);
  if (window_.size() != size) cv::createHanningWindow(window_, size, CV_32F);
  double clear = 0;
  const cv::Point2d shift = 4 * cv::phaseCorrelate(then_, now_, window_, &clear);
  const bool moved = clear > kClear && std::hypot(shift.x, shift.y) > kLeast_px &&
                     std::hypot(shift.x, shift.y) < kMostShare * room.width;
  const bool again = alike_ > 0 && std::hypot(shift.x - last_.x, shift.y - last_.y) < kAgree_px;
  alike_ = !moved ? 0 : again ? alike_ + 1 : 1;
  last_ = shift;
  if (alike_ < kLooks) return std::nullopt;
  alike_ = 0;
  return shift;
}

BackgroundModel MovedAlong(const BackgroundModel& room, const cv::Point2d& shift_px) {
  BackgroundModel moved;
  moved.width = room.width;
  moved.height = room.height;
  const cv::Point2d half = 0.5 * shift_px, quarter = 0.25 * shift_px;
  for (std::size_t c = 0; c < 3; ++c) {
    Move(room.mean[c], half, cv::INTER_LINEAR, moved.mean[c]);
    Move(room.variance[c], half, cv::INTER_LINEAR, moved.variance[c]);
    cv::Mat1f across, down;
    cv::Sobel(moved.mean[c], across, CV_32F, 1, 0, 3, 0.125);
    cv::Sobel(moved.mean[c], down, CV_32F, 0, 1, 3, 0.125);
    moved.variance[c] += kDoubt * (across.mul(across) + down.mul(down));
  }
  const cv::Mat1b seen =
      room.seen.empty() ? cv::Mat1b(room.mean[0].size(), RoomPrediction::kSeen) : room.seen;
  cv::warpAffine(seen, moved.seen, cv::Matx23d(1, 0, half.x, 0, 1, half.y), seen.size(), cv::INTER_NEAREST,
                 cv::BORDER_CONSTANT, cv::Scalar(0));
  for (cv::Mat1f& variance : moved.variance) variance.setTo(kUnknownVariance, moved.seen == 0);
  FinishColor(&moved);
  if (!room.has_depth()) return moved;
  Move(room.room_depth_m, quarter, cv::INTER_NEAREST, moved.room_depth_m);
  Move(room.sigma_m, quarter, cv::INTER_NEAREST, moved.sigma_m);
  cv::Mat1f weight;
  Move(room.depth_weight, quarter, cv::INTER_NEAREST, weight);
  FinishDepth(cv::Mat1f(weight.size(), 1.0f), &moved);
  cv::min(cv::InputArray(moved.depth_weight), weight, moved.depth_weight);
  return moved;
}

}  // namespace mixstage
