// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/tone_change.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace mixstage {
namespace {

constexpr int kMaxPoints = 4096;
struct Points {
  int count = 0;
  // Whole groups of eight; of the last group, those beyond count weigh nothing.
  [[nodiscard]] std::size_t padded() const { return (static_cast<std::size_t>(count) + 7) / 8 * 8; }
  std::array<float, kMaxPoints> counts;  // 1 or, in the padding, 0
  std::array<std::array<float, kMaxPoints>, 3> room;
  std::array<std::array<float, kMaxPoints>, 3> now;
};

void Collect(const HalfPicture& picture, const std::array<cv::Mat1f, 3>& mean, const cv::Mat1b& actor,
             Points* points) {
  const double area = static_cast<double>(picture.width()) * picture.height();
  const int step = std::max(2, static_cast<int>(std::ceil(std::sqrt(area / kMaxPoints))));
  for (int y = step / 2; y < picture.height(); y += step) {
    for (int x = step / 2; x < picture.width() && points->count < kMaxPoints; x += step) {
      if (!actor.empty() && actor(y, x) > 0) continue;
      const std::array<int, 3> now = {picture.r(y, x), picture.g(y, x), picture.b(y, x)};
      const std::array<float, 3> room = {mean[0](y, x), mean[1](y, x), mean[2](y, x)};
      // Clipped pixels do not follow the gain.
      if (std::max({now[0], now[1], now[2]}) > 245 || std::max({room[0], room[1], room[2]}) > 240) continue;
      if (std::min({room[0], room[1], room[2]}) < 5) continue;
      const auto i = static_cast<std::size_t>(points->count++);
      for (std::size_t c = 0; c < 3; ++c) {
        points->room[c][i] = room[c];
        points->now[c][i] = static_cast<float>(now[c]);
      }
    }
  }
}

// The most frequent ratio: survives actors and shadows that cover up to half of the picture.
float CommonRatio(const std::array<float, kMaxPoints>& room, const std::array<float, kMaxPoints>& now,
                  int count) {
  constexpr int kBins = 560;
  constexpr float kLow = 0.2f, kHigh = 3.0f;  // lamps that are switched, too
  std::array<int, kBins> histogram{};
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const float ratio = (now[i] + 2) / (room[i] + 2);
    const int bin = static_cast<int>((ratio - kLow) * (kBins / (kHigh - kLow)));
    if (bin >= 0 && bin < kBins) ++histogram[static_cast<std::size_t>(bin)];
  }
  int best = 0;
  int best_votes = -1;
  for (int i = 3; i + 3 < kBins; ++i) {
    int votes = 0;
    for (int k = -3; k <= 3; ++k) votes += (4 - std::abs(k)) * histogram[static_cast<std::size_t>(i + k)];
    if (votes > best_votes) best = i, best_votes = votes;
  }
  return kLow + (static_cast<float>(best) + 0.5f) * (kHigh - kLow) / kBins;
}

}  // namespace

ToneChange FindToneChange(const HalfPicture& picture, const std::array<cv::Mat1f, 3>& mean,
                          const cv::Mat1b& actor) {
  Points points;
  Collect(picture, mean, actor, &points);
  const auto known = static_cast<std::size_t>(points.count);
  std::fill_n(points.counts.begin(), known, 1.0f);
  for (std::size_t i = known; i < points.padded(); ++i) {
    points.counts[i] = 0;
    for (std::size_t c = 0; c < 3; ++c) points.room[c][i] = points.now[c][i] = 0;
  }
  ToneChange tone;
  if (points.count < 100) return tone;
  for (std::size_t c = 0; c < 3; ++c) {
    const float ratio = CommonRatio(points.room[c], points.now[c], points.count);
    float gain = ratio;
    float offset = 2 * (ratio - 1);
    for (const float scale : {12.0f, 8.0f, 6.0f, 4.0f}) {
      // Lane by lane: independent sums are what a compiler can make vectors of.
      constexpr std::size_t kLanes = 8;
      std::array<std::array<float, kLanes>, 5> lanes{};
      for (std::size_t i = 0; i < points.padded(); i += kLanes) {
        const float* rooms = points.room[c].data() + i;
        const float* nows = points.now[c].data() + i;
        const float* counts = points.counts.data() + i;
        for (std::size_t k = 0; k < kLanes; ++k) {
          const float error = (nows[k] - gain * rooms[k] - offset) / scale;
          const float root = 1 / (1 + error * error);
          const float weight = counts[k] * root * root;  // Geman-McClure: an actor's pixels count for nothing
          lanes[0][k] += weight;
          lanes[1][k] += weight * rooms[k];
          lanes[2][k] += weight * nows[k];
          lanes[3][k] += weight * rooms[k] * rooms[k];
          lanes[4][k] += weight * rooms[k] * nows[k];
        }
      }
      std::array<float, 5> sums{};
      for (std::size_t j = 0; j < sums.size(); ++j)
        sums[j] = std::accumulate(lanes[j].begin(), lanes[j].end(), 0.0f);
      const auto [sum, sum_room, sum_now, sum_rr, sum_rn] = sums;
      if (sum < 30) break;
      const float mean_room = sum_room / sum;
      const float mean_now = sum_now / sum;
      const float spread = sum_rr - sum * mean_room * mean_room;
      const float common = sum_rn - sum * mean_room * mean_now;
      const float prior = sum * 15 * 15;  // a room of one brightness fixes no slope: stay at the common ratio
      gain = std::clamp((common + prior * ratio) / (std::max(spread, 0.0f) + prior), 0.3f, 3.0f);
      offset = std::clamp(mean_now - gain * mean_room, -40.0f, 40.0f);
    }
    tone.gain[c] = gain;
    tone.offset[c] = offset;
  }
  return tone;
}

}  // namespace mixstage
