// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/refined_background.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/median.h"
#include "server/segmentation/labels.h"

namespace mixstage {
namespace {

constexpr float kWithin = 25.0f;    // squared sigmas of the prediction, each channel
constexpr int kAwayFromActor = 17;  // half pixels, the side of a square: his outline, his contact shadow
constexpr int kLevels = 16;
constexpr float kLeastSigma = 0.8f;   // 8 bit, JPEG
constexpr float kPriorFrames = 8.0f;  // frames' worth of trust in the camera's typical noise at a brightness

int LevelOf(float brightness) {
  return std::clamp(static_cast<int>(brightness) * kLevels / 256, 0, kLevels - 1);
}

}  // namespace

void RefinedBackground::Begin(std::shared_ptr<const BackgroundModel> predicted) {
  predicted_ = std::move(predicted);
  samples_ = 0;
}

void RefinedBackground::Add(const HalfPicture& picture, const ToneChange& tone, const cv::Mat1b& half_mask,
                            ImageView<const std::uint8_t> label) {
  MIX_CHECK(predicted_ != nullptr && picture.r.size() == predicted_->mean[0].size());
  MIX_CHECK(half_mask.size() == picture.r.size() && label.width() == predicted_->width &&
            label.height() == predicted_->height);
  if (complete()) return;
  if (samples_ == 0) {
    for (cv::Mat1f* plane : {&count_, &sum_[0], &sum_[1], &sum_[2], &square_[0], &square_[1], &square_[2]}) {
      plane->create(picture.r.size());
      plane->setTo(0);
    }
  }
  ++samples_;
  cv::dilate(half_mask, around_, cv::getStructuringElement(cv::MORPH_RECT, {kAwayFromActor, kAwayFromActor}));
  const std::array<const cv::Mat1b*, 3> now = {&picture.r, &picture.g, &picture.b};
  for (int y = 0; y < picture.height(); ++y) {
    const std::uint8_t* what = label.row(2 * y);
    for (int x = 0; x < picture.width(); ++x) {
      if (around_(y, x) != 0 || what[2 * x] != kLabelBackground) continue;
      std::array<float, 3> difference{};
      bool room = true;
      for (std::size_t c = 0; c < 3; ++c) {
        difference[c] =
            (static_cast<float>((*now[c])(y, x)) - tone.offset[c]) / tone.gain[c] - predicted_->mean[c](y, x);
        room &= difference[c] * difference[c] < kWithin * predicted_->variance[c](y, x);
      }
      if (!room) continue;
      count_(y, x) += 1;
      for (std::size_t c = 0; c < 3; ++c) {
        sum_[c](y, x) += difference[c];
        square_[c](y, x) += difference[c] * difference[c];
      }
    }
  }
}

void RefinedBackground::Refine(BackgroundModel* model) const {
  MIX_CHECK(model != nullptr && predicted_ != nullptr && samples_ > 0);
  const cv::Size size = predicted_->mean[0].size();
  model->width = predicted_->width;
  model->height = predicted_->height;
  model->seen = predicted_->seen;
  for (std::size_t c = 0; c < 3; ++c) {
    predicted_->mean[c].copyTo(model->mean[c]);
    model->variance[c].create(size);
    // The camera's noise at each brightness, from the pixels' own spreads.
    std::array<std::vector<float>, kLevels> spreads;
    cv::Mat1f own(size, 0.0f);  // squared
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const float n = count_(y, x);
        if (n < kFewestSamples) continue;
        const float mean = sum_[c](y, x) / n;
        own(y, x) = std::max(square_[c](y, x) - n * mean * mean, 0.0f) / (n - 1);
        model->mean[c](y, x) = std::clamp(predicted_->mean[c](y, x) + mean, 0.0f, 255.0f);
        spreads[static_cast<std::size_t>(LevelOf(model->mean[c](y, x)))].push_back(own(y, x));
      }
    }
    std::array<float, kLevels> floor{};
    for (std::size_t i = 0; i < kLevels; ++i)
      floor[i] = std::max(kLeastSigma * kLeastSigma, spreads[i].empty() ? 0.0f : Median(spreads[i]));
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const float n = count_(y, x);
        const float doubt = predicted_->variance[c](y, x);
        if (n < kFewestSamples) {
          model->variance[c](y, x) = doubt;
          continue;
        }
        const float camera = floor[static_cast<std::size_t>(LevelOf(model->mean[c](y, x)))];
        const float pooled = (kPriorFrames * camera + n * own(y, x)) / (kPriorFrames + n);
        model->variance[c](y, x) = std::min(std::max(pooled, camera) + doubt / (n * n), doubt);
      }
    }
    cv::blur(model->variance[c], model->variance[c], {3, 3}, {-1, -1}, cv::BORDER_REPLICATE);
  }
  FinishColor(model);
  model->room_depth_m = predicted_->room_depth_m;
  model->sigma_m = predicted_->sigma_m;
  model->depth_weight = predicted_->depth_weight;
  model->log_peak_depth = predicted_->log_peak_depth;
}

}  // namespace mixstage
