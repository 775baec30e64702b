// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/background_model.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/median.h"

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
  FinishColor(model);
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
  const std::vector<float> typical = SigmaByDistance(s);
  model->room_depth_m = s.depth_m.clone();
  model->sigma_m.create(s.depth_m.size());
  model->sigma_m.setTo(0);
  for (int y = 0; y < s.depth_m.rows; ++y) {
    for (int x = 0; x < s.depth_m.cols; ++x) {
      const float z = s.depth_m(y, x);
      if (z <= 0) continue;
      const auto bin = static_cast<std::size_t>(z * 2);
      const float floor = bin < typical.size() ? typical[bin] : 0.0f;
      const float own = std::sqrt(std::max(pooled(y, x), 0.0f) / std::max(count(y, x), 0.04f));
      const float steps = kDepthSigmaPerMetre * z * z;
      model->sigma_m(y, x) = std::hypot(std::hypot(std::max(own, floor), kLeastDepthSigma_m), steps);
    }
  }
  FinishDepth(s.depth_share, model);
}

// ln x within 0.0002 of its logarithm, x > 0 and no denormal: std::log is a call for every pixel.
float QuickLog(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  const auto exponent = static_cast<float>(static_cast<std::int32_t>(bits >> 23) - 127);
  const float m = std::bit_cast<float>((bits & 0x007F'FFFFu) | 0x3F80'0000u);  // 1..2
  const float log2_m =
      -2.786887f + m * (5.047106f + m * (-3.492776f + m * (1.594069f + m * (-0.404916f + m * 0.043434f))));
  return 0.69314718f * (exponent + log2_m);
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

void FinishColor(BackgroundModel* model) {
  model->texture_noise = TextureNoise(model->variance[1]);
  const cv::Size size = model->mean[0].size();
  model->log_peak_room.create(size);
  model->log_peak_shadow.create(size);
  model->mean_luma.create(size);
  const float log_range = std::log(255.0f);
  for (int y = 0; y < size.height; ++y) {
    const std::array<const float*, 3> mean = {model->mean[0].ptr<float>(y), model->mean[1].ptr<float>(y),
                                              model->mean[2].ptr<float>(y)};
    const std::array<const float*, 3> variance = {
        model->variance[0].ptr<float>(y), model->variance[1].ptr<float>(y), model->variance[2].ptr<float>(y)};
    float* __restrict room = model->log_peak_room.ptr<float>(y);
    float* __restrict shadow = model->log_peak_shadow.ptr<float>(y);
    float* __restrict luma = model->mean_luma.ptr<float>(y);
    for (int x = 0; x < size.width; ++x) {
      constexpr float kTwoPiCubed = 8 * kPi * kPi * kPi;
      const float half_log = 0.5f * QuickLog(kTwoPiCubed * variance[0][x] * variance[1][x] * variance[2][x]);
      const float square = mean[0][x] * mean[0][x] + mean[1][x] * mean[1][x] + mean[2][x] * mean[2][x];
      room[x] = half_log - 3 * log_range;
      // In shadow the brightness is free on a stretch of 0.6 |I_m|; the two chromatic directions stay
      // Gaussian.
      const float stretch_squared = std::max(0.36f * square, 1.0f);
      shadow[x] = half_log * (2.0f / 3.0f) - 3 * log_range + 0.5f * QuickLog(stretch_squared);
      luma[x] = 0.299f * mean[0][x] + 0.587f * mean[1][x] + 0.114f * mean[2][x];
    }
    if (model->seen.empty()) continue;
    const std::uint8_t* seen = model->seen.ptr<std::uint8_t>(y);
    for (int x = 0; x < size.width; ++x) {
      if (seen[x] == 0) room[x] = shadow[x] = 0;
    }
  }
}

void FinishDepth(const cv::Mat1f& share, BackgroundModel* model) {
  const cv::Mat1f& room = model->room_depth_m;
  cv::Mat1f farthest, nearest;
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
  cv::dilate(room, farthest, kernel);
  cv::Mat1f filled = room.clone();
  cv::Mat1b hole;
  cv::compare(room, 0, hole, cv::CMP_LE);
  filled.setTo(1e6f, hole);
  cv::erode(filled, nearest, kernel);
  for (cv::Mat1f* plane : {&model->depth_weight, &model->log_peak_depth}) {
    plane->create(room.size());
    plane->setTo(0);
  }
  for (int y = 0; y < room.rows; ++y) {
    for (int x = 0; x < room.cols; ++x) {
      const float z = room(y, x);
      if (z <= 0) continue;
      const float sigma = model->sigma_m(y, x);
      // Beside a step a measurement may belong to either side (mixed pixels, parallax, registration).
      const float step = (farthest(y, x) - nearest(y, x)) / (4 * sigma);
      model->depth_weight(y, x) = std::min(2 * share(y, x), 1.0f) / (1 + step * step);
      model->log_peak_depth(y, x) = QuickLog(std::sqrt(2 * kPi) * sigma / z);
    }
  }
}

}  // namespace mixstage
