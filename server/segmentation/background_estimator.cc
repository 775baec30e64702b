// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/background_estimator.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "proto/base/check.h"
#include "server/segmentation/robust_background.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {
namespace {

const cv::Mat1b& Channel(const HalfPicture& picture, std::size_t c) {
  return c == 0 ? picture.r : c == 1 ? picture.g : picture.b;
}

// Share of pixels that differ from `mean` by more than noise after the sample's tone change. Compared on 4x4
// means: single pixels of a noisy sensor leave any threshold now and then, an actor's blocks do so together.
float ChangedShare(const HalfPicture& picture, const std::array<cv::Mat1f, 3>& mean) {
  const ToneChange tone = FindToneChange(picture, mean, cv::Mat1b());
  int blocks = 0;
  int changed = 0;
  for (int y = 0; y + 4 <= picture.height(); y += 4) {
    for (int x = 0; x + 4 <= picture.width(); x += 4) {
      float worst = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const cv::Rect block(x, y, 4, 4);
        float difference = 0;
        for (int dy = 0; dy < 4; ++dy) {
          for (int dx = 0; dx < 4; ++dx) {
            difference += static_cast<float>(Channel(picture, c)(y + dy, x + dx)) - tone.offset[c] -
                          tone.gain[c] * mean[c](y + dy, x + dx);
          }
        }
        worst = std::max(worst, std::abs(difference) / 16);
      }
      ++blocks;
      changed += worst > 12 ? 1 : 0;
    }
  }
  return blocks == 0 ? 0.0f : static_cast<float>(changed) / static_cast<float>(blocks);
}

std::array<cv::Mat1f, 3> MeanPicture(const std::vector<BackgroundEstimator::Sample>& samples) {
  std::array<cv::Mat1f, 3> mean;
  for (std::size_t c = 0; c < 3; ++c) {
    mean[c].create(samples[0].picture.r.size());
    mean[c].setTo(0);
    for (const auto& sample : samples) cv::accumulate(Channel(sample.picture, c), mean[c]);
    mean[c].convertTo(mean[c], CV_32F, 1.0 / static_cast<double>(samples.size()));
  }
  return mean;
}

// D_M and sigma of MixIn3D eq (1), over the frames that measured the pixel.
void MeanDepth(const std::vector<BackgroundEstimator::Sample>& samples, RoomStatistics* s) {
  std::vector<const cv::Mat1f*> depths;
  for (const auto& sample : samples) {
    if (!sample.depth_m.empty()) depths.push_back(&sample.depth_m);
  }
  if (depths.empty()) return;
  for (cv::Mat1f* plane : {&s->depth_m, &s->depth_sigma_m, &s->depth_share}) {
    plane->create(depths[0]->size());
    plane->setTo(0);
  }
  const auto frames = static_cast<double>(depths.size());
  for (int y = 0; y < s->depth_m.rows; ++y) {
    for (int x = 0; x < s->depth_m.cols; ++x) {
      double sum = 0, square = 0, count = 0;
      for (const cv::Mat1f* depth : depths) {
        const double z = (*depth)(y, x);
        sum += z;
        square += z * z;
        count += z > 0 ? 1 : 0;
      }
      // A pixel measured in fewer than a quarter of the frames is noise between holes, not a surface.
      if (count < std::max(1.0, 0.25 * frames)) continue;
      const double mean = sum / count;
      s->depth_m(y, x) = static_cast<float>(mean);
      s->depth_sigma_m(y, x) = static_cast<float>(std::sqrt(std::max(square / count - mean * mean, 0.0)));
      s->depth_share(y, x) = static_cast<float>(count / frames);
    }
  }
}

}  // namespace

Result<BackgroundEstimator> BackgroundEstimator::Create(const BackgroundEstimatorConfig& config, int width,
                                                        int height) {
  if (width < 16 || height < 16 || width > 16384 || height > 16384) {
    return Fail(ErrorCode::kInvalidConfig, "the picture must have 16 to 16384 pixels a side, not " +
                                               std::to_string(width) + "x" + std::to_string(height));
  }
  if (config.max_samples < 1 || config.max_samples > 120) {
    return Fail(ErrorCode::kInvalidConfig, "max_samples must be 1 to 120");
  }
  if (!(config.empty_share > 0 && config.empty_share < 1) ||
      !(config.far_share > 0 && config.far_share <= 0.5f)) {
    return Fail(ErrorCode::kInvalidConfig, "empty_share must lie in 0..1 and far_share in 0..0.5");
  }
  return BackgroundEstimator(config, width, height);
}

void BackgroundEstimator::Add(const HalfPicture& picture, ImageView<const float> depth_m) {
  MIX_CHECK(picture.width() == Half(width_) && picture.height() == Half(height_));
  MIX_CHECK(depth_m.empty() || (depth_m.width() == width_ && depth_m.height() == height_));
  if (++skipped_ < stride_) return;
  skipped_ = 0;
  if (size() == config_.max_samples) {
    std::vector<Sample> kept;
    for (std::size_t i = 0; i < samples_.size(); i += 2) kept.push_back(std::move(samples_[i]));
    samples_ = std::move(kept);
    stride_ *= 2;
    if (size() >= config_.max_samples) return;  // a store of one
  }
  Sample sample;
  sample.picture = {picture.r.clone(), picture.g.clone(), picture.b.clone()};
  if (!depth_m.empty()) QuarterDepth(depth_m, &sample.depth_m);
  samples_.push_back(std::move(sample));
}

void BackgroundEstimator::Clear() {
  samples_.clear();
  stride_ = 1;
  skipped_ = 0;
}

bool BackgroundEstimator::IsStill() const {
  if (samples_.empty()) return false;
  const auto mean = MeanPicture(samples_);
  for (const Sample& sample : samples_) {
    if (ChangedShare(sample.picture, mean) > config_.empty_share) return false;
  }
  return true;
}

bool BackgroundEstimator::Agrees(const BackgroundModel& model) const {
  if (samples_.empty() || model.width != width_ || model.height != height_) return false;
  for (const Sample& sample : samples_) {
    if (ChangedShare(sample.picture, model.mean) > config_.empty_share) return false;
  }
  return true;
}

Result<BackgroundModel> BackgroundEstimator::EstimateEmpty() const {
  if (samples_.empty()) return Fail(ErrorCode::kUnavailable, "no frame of the empty set was given");
  RoomStatistics s;
  s.width = width_;
  s.height = height_;
  s.sample_count = size();
  s.mean = MeanPicture(samples_);  // piVE eq (1)
  for (std::size_t c = 0; c < 3; ++c) {
    s.sigma[c].create(s.mean[c].size());
    s.sigma[c].setTo(0);
    cv::Mat1f difference;
    for (const Sample& sample : samples_) {
      cv::subtract(Channel(sample.picture, c), s.mean[c], difference, cv::noArray(), CV_32F);
      cv::accumulateSquare(difference, s.sigma[c]);
    }
    s.sigma[c].convertTo(s.sigma[c], CV_32F, 1.0 / size());
    cv::sqrt(s.sigma[c], s.sigma[c]);  // piVE eq (2)
  }
  MeanDepth(samples_, &s);
  return MakeBackgroundModel(s);
}

Result<BackgroundModel> BackgroundEstimator::EstimateRobust() const {
  if (size() < 3) return Fail(ErrorCode::kUnavailable, "a robust background needs at least 3 frames");
  RoomStatistics s;
  s.width = width_;
  s.height = height_;
  s.sample_count = std::max(3, size() / 2);  // about half of the samples show the room at a pixel
  FarthestDepth(samples_, config_.far_share, &s);
  MostFrequentColor(samples_, &s);
  return MakeBackgroundModel(s);
}

}  // namespace mixstage
