// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/background_model.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr float kPi = 3.14159265f;
// Quantisation to 8 bit and JPEG's own rounding: below this no statistic of a few frames is believed.
constexpr float kLeastColorSigma = 0.8f;
// Frames' worth of trust in the sensor's typical noise at a pixel's brightness against the pixel's own
// statistics.
constexpr float kPriorFrames = 8.0f;
constexpr int kLevels = 16;
// Floor of a depth measurement: 3 mm, and disparity sensors' steps that grow with z squared.
constexpr float kLeastDepthSigma_m = 0.003f;
constexpr float kDepthSigmaPerMetre = 0.0015f;  // times z squared

float Median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Noise that a single picture shows in itself (Immerkaer): needed where one or two frames have no spread to
// measure.
float SpatialNoise(const cv::Mat1f& picture) {
  std::vector<float> response;
  for (int y = 1; y + 1 < picture.rows; y += 2) {
    for (int x = 1; x + 1 < picture.cols; x += 2) {
      const auto at = [&](int dx, int dy) { return picture(y + dy, x + dx); };
      response.push_back(std::abs(at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1) -
                                  2 * (at(0, -1) + at(-1, 0) + at(1, 0) + at(0, 1)) + 4 * at(0, 0)));
    }
  }
  return response.empty() ? 0.0f : Median(response) / (0.6745f * 6.0f);
}

// Typical sigma of one channel at each brightness: shot noise makes the sensor's floor a curve, not a number.
std::array<float, kLevels> SigmaByLevel(const cv::Mat1f& mean, const cv::Mat1f& sigma, float least) {
  std::array<std::vector<float>, kLevels> found;
  for (int y = 0; y < mean.rows; ++y) {
    for (int x = 0; x < mean.cols; ++x) {
      const int level = std::clamp(static_cast<int>(mean(y, x)) * kLevels / 256, 0, kLevels - 1);
      found[static_cast<std::size_t>(level)].push_back(sigma(y, x));
    }
  }
  std::array<float, kLevels> floors{};
  for (std::size_t i = 0; i < found.size(); ++i) {
    floors[i] = std::max(least, found[i].empty() ? 0.0f : Median(found[i]));
  }
  return floors;
}

cv::Mat1f ColorVariance(const cv::Mat1f& mean, const cv::Mat1f& sigma, int frames) {
  const float least = frames < 4 ? std::max(kLeastColorSigma, SpatialNoise(mean)) : kLeastColorSigma;
  const auto floors = SigmaByLevel(mean, sigma, least);
  cv::Mat1f variance(mean.size());
  for (int y = 0; y < mean.rows; ++y) {
    for (int x = 0; x < mean.cols; ++x) {
      const int level = std::clamp(static_cast<int>(mean(y, x)) * kLevels / 256, 0, kLevels - 1);
      const float floor = floors[static_cast<std::size_t>(level)];
      const float own = sigma(y, x);
      const float n = static_cast<float>(frames);
      // A handful of frames measures a standard deviation badly: pull it towards the sensor's, never below.
      const float pooled = (kPriorFrames * floor * floor + n * own * own) / (kPriorFrames + n);
      variance(y, x) = std::max(pooled, floor * floor);
    }
  }
  cv::blur(variance, variance, {3, 3}, {-1, -1}, cv::BORDER_REPLICATE);
  return variance;
}

// Two rows' worth of luma's variance (about half of green's, 1.5 times for JPEG), over ShadowTexture's
// window.
cv::Mat1f TextureNoise(const cv::Mat1f& green_variance) {
  cv::Mat1f noise(Half(green_variance.rows), Half(green_variance.cols));
  for (int y = 0; y < noise.rows; ++y) {
    for (int x = 0; x < noise.cols; ++x) {
      const int below = std::min(2 * y + 1, green_variance.rows - 1);
      noise(y, x) = 0.75f * (green_variance(2 * y, 2 * x) + green_variance(below, 2 * x));
    }
  }
  cv::blur(noise, noise, {3, 3}, {-1, -1}, cv::BORDER_REPLICATE);
  return noise;
}

void SetColor(const RoomStatistics& s, BackgroundModel* model) {
  for (std::size_t c = 0; c < 3; ++c) {
    model->mean[c] = s.mean[c].clone();
    model->variance[c] = ColorVariance(s.mean[c], s.sigma[c], s.sample_count);
  }
  model->texture_noise = TextureNoise(model->variance[1]);
  const cv::Size size = s.mean[0].size();
  model->log_peak_room.create(size);
  model->log_peak_shadow.create(size);
  model->mean_luma.create(size);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      float half_log = 0;
      float square = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        half_log += 0.5f * std::log(2 * kPi * model->variance[c](y, x));
        square += model->mean[c](y, x) * model->mean[c](y, x);
      }
      const float log_range = std::log(255.0f);
      model->log_peak_room(y, x) = half_log - 3 * log_range;
      // In shadow the brightness is free on a stretch of 0.6 |I_m|; the two chromatic directions stay
      // Gaussian.
      const float stretch = std::max(0.6f * std::sqrt(square), 1.0f);
      model->log_peak_shadow(y, x) = half_log * (2.0f / 3.0f) - 3 * log_range + std::log(stretch);
      model->mean_luma(y, x) =
          0.299f * model->mean[0](y, x) + 0.587f * model->mean[1](y, x) + 0.114f * model->mean[2](y, x);
    }
  }
}

// Typical sigma at each distance (half-metre bins): ToF noise grows with range, disparity noise with its
// square.
std::vector<float> SigmaByDistance(const RoomStatistics& s) {
  std::vector<std::vector<float>> bins;
  for (int y = 0; y < s.depth_m.rows; ++y) {
    for (int x = 0; x < s.depth_m.cols; ++x) {
      const float z = s.depth_m(y, x);
      if (z <= 0 || z > 100 || s.depth_share(y, x) < 0.3f) continue;
      const auto bin = static_cast<std::size_t>(z * 2);
      if (bins.size() <= bin) bins.resize(bin + 1);
      bins[bin].push_back(s.depth_sigma_m(y, x));
    }
  }
  std::vector<float> typical(bins.size(), 0.0f);
  for (std::size_t i = 0; i < bins.size(); ++i) {
    if (bins[i].size() >= 20) typical[i] = Median(bins[i]);
  }
  return typical;
}

void SetDepth(const RoomStatistics& s, BackgroundModel* model) {
  if (s.depth_m.empty()) return;
  cv::Mat1f known, pooled, count;
  cv::threshold(s.depth_m, known, 0, 1, cv::THRESH_BINARY);
  cv::multiply(s.depth_sigma_m, s.depth_sigma_m, pooled);
  cv::multiply(pooled, known, pooled);
  cv::blur(pooled, pooled, {5, 5}, {-1, -1}, cv::BORDER_REPLICATE);
  cv::blur(known, count, {5, 5}, {-1, -1}, cv::BORDER_REPLICATE);
  cv::Mat1f farthest, nearest;
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
  cv::dilate(s.depth_m, farthest, kernel);
  cv::Mat1f filled = s.depth_m.clone();
  cv::Mat1b hole;
  cv::compare(s.depth_m, 0, hole, cv::CMP_LE);
  filled.setTo(1e6f, hole);
  cv::erode(filled, nearest, kernel);

  const std::vector<float> typical = SigmaByDistance(s);
  model->room_depth_m = s.depth_m.clone();
  for (cv::Mat1f* plane : {&model->sigma_m, &model->depth_weight, &model->log_peak_depth}) {
    plane->create(s.depth_m.size());
    plane->setTo(0);
  }
  for (int y = 0; y < s.depth_m.rows; ++y) {
    for (int x = 0; x < s.depth_m.cols; ++x) {
      const float z = s.depth_m(y, x);
      if (z <= 0) continue;
      const auto bin = static_cast<std::size_t>(z * 2);
      const float floor = bin < typical.size() ? typical[bin] : 0.0f;
      const float own = std::sqrt(std::max(pooled(y, x), 0.0f) / std::max(count(y, x), 0.04f));
      const float steps = kDepthSigmaPerMetre * z * z;
      const float sigma = std::hypot(std::hypot(std::max(own, floor), kLeastDepthSigma_m), steps);
      model->sigma_m(y, x) = sigma;
      // Beside a step a measurement may belong to either side (mixed pixels, parallax, registration).
      const float step = (farthest(y, x) - nearest(y, x)) / (4 * sigma);
      const float share = std::min(2 * s.depth_share(y, x), 1.0f);
      model->depth_weight(y, x) = share / (1 + step * step);
      model->log_peak_depth(y, x) = std::log(std::sqrt(2 * kPi) * sigma / z);
    }
  }
}

}  // namespace

void QuarterDepth(ImageView<const float> depth_m, cv::Mat1f* quarter) {
  MIX_CHECK(quarter != nullptr && !depth_m.empty());
  quarter->create(Quarter(depth_m.height()), Quarter(depth_m.width()));
  for (int y = 0; y < quarter->rows; ++y) {
    const float* from = depth_m.row(std::min(4 * y + 1, depth_m.height() - 1));
    float* to = quarter->ptr<float>(y);
    for (int x = 0; x < quarter->cols; ++x) {
      const float z = from[std::min(4 * x + 1, depth_m.width() - 1)];
      to[x] = z > 0 && z < 1e4f ? z : 0.0f;  // NaN and infinity are holes too
    }
  }
}

BackgroundModel MakeBackgroundModel(const RoomStatistics& statistics) {
  BackgroundModel model;
  model.width = statistics.width;
  model.height = statistics.height;
  SetColor(statistics, &model);
  SetDepth(statistics, &model);
  return model;
}

}  // namespace mixstage
