// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/robust_background.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "server/segmentation/tone_change.h"

namespace mixstage {
namespace {

// Depths closer than this may be one surface: 4 sigma of a ToF or disparity sensor at that distance.
float SameSurface_m(float z) { return 0.02f + 0.01f * z * z; }

// Grey levels within which two samples (tone change removed) show the same thing.
constexpr int kSameColor = 9;

struct Planes {
  std::array<cv::Mat1b, 3> channel;
  cv::Mat1b usable;  // [Half(h) x Half(w)] 1 = may vote
};

cv::Mat1b RemoveTone(const cv::Mat1b& plane, float gain, float offset) {
  cv::Mat1b table(1, 256);
  for (int i = 0; i < 256; ++i) {
    // A clipped value stays clipped: divided by a gain above one it would look like a change.
    const float value =
        i >= 250 && gain > 1 ? static_cast<float>(i) : (static_cast<float>(i) - offset) / gain;
    table(0, i) = cv::saturate_cast<std::uint8_t>(value);
  }
  cv::Mat1b out;
  cv::LUT(plane, table, out);
  return out;
}

// The temporal median as first reference; from ten samples at most, spread evenly.
std::array<cv::Mat1f, 3> FirstReference(std::span<const BackgroundEstimator::Sample> samples) {
  const std::size_t count = std::min<std::size_t>(samples.size(), 15);
  std::array<cv::Mat1f, 3> reference;
  for (std::size_t c = 0; c < 3; ++c) {
    reference[c].create(samples[0].picture.r.size());
    std::array<std::uint8_t, 15> values{};
    for (int y = 0; y < reference[c].rows; ++y) {
      for (int x = 0; x < reference[c].cols; ++x) {
        for (std::size_t i = 0; i < count; ++i) {
          const HalfPicture& picture = samples[i * samples.size() / count].picture;
          values[i] = (c == 0 ? picture.r : c == 1 ? picture.g : picture.b)(y, x);
        }
        std::nth_element(values.begin(), values.begin() + count / 2, values.begin() + count);
        reference[c](y, x) = values[count / 2];
      }
    }
  }
  return reference;
}

cv::Mat1b InFront(const BackgroundEstimator::Sample& sample, const cv::Mat1f& room_m) {
  cv::Mat1b front(sample.picture.r.size(), std::uint8_t{0});
  if (sample.depth_m.empty() || room_m.empty()) return front;
  for (int y = 0; y < front.rows; ++y) {
    for (int x = 0; x < front.cols; ++x) {
      const float room = room_m(y / 2, x / 2);
      const float z = sample.depth_m(y / 2, x / 2);
      front(y, x) = room > 0 && z > 0 && room - z > SameSurface_m(room) ? 255 : 0;
    }
  }
  return front;
}

// The temporal median of the samples that may vote, channel by channel.
std::vector<std::array<std::uint8_t, 3>> MedianRow(const std::vector<Planes>& planes, int y) {
  std::vector<std::array<std::uint8_t, 3>> middle(static_cast<std::size_t>(planes[0].usable.cols));
  std::vector<std::uint8_t> values;
  for (std::size_t x = 0; x < middle.size(); ++x) {
    for (std::size_t c = 0; c < 3; ++c) {
      values.clear();
      for (const Planes& sample : planes) {
        if (sample.usable(y, static_cast<int>(x)) != 0)
          values.push_back(sample.channel[c](y, static_cast<int>(x)));
      }
      if (values.empty()) continue;
      const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), half, values.end());
      middle[x][c] = *half;
    }
  }
  return middle;
}

int DistanceFromMedian(const Planes& sample, const std::vector<std::array<std::uint8_t, 3>>& middle, int x,
                       int y) {
  int away = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    away = std::max(away, std::abs(sample.channel[c](y, x) - middle[static_cast<std::size_t>(x)][c]));
  }
  return away;
}

// One row: for each sample the number of samples that look like it; the winner's cluster gives mean and
// sigma.
void VoteRow(const std::vector<Planes>& planes, int y, RoomStatistics* s) {
  const int width = s->mean[0].cols;
  const std::size_t n = planes.size();
  std::vector<std::uint8_t> votes(static_cast<std::size_t>(width)), best(votes.size(), 0),
      winner(votes.size(), 0);
  std::vector<std::uint8_t> nearest(votes.size(), 255), at_median(votes.size(), 0),
      median_votes(votes.size(), 0);
  const std::vector<std::array<std::uint8_t, 3>> middle = MedianRow(planes, y);
  for (std::size_t i = 0; i < n; ++i) {
    std::fill(votes.begin(), votes.end(), std::uint8_t{0});
    const std::uint8_t* r0 = planes[i].channel[0].ptr<std::uint8_t>(y);
    const std::uint8_t* g0 = planes[i].channel[1].ptr<std::uint8_t>(y);
    const std::uint8_t* b0 = planes[i].channel[2].ptr<std::uint8_t>(y);
    const std::uint8_t* own = planes[i].usable.ptr<std::uint8_t>(y);
    for (std::size_t j = 0; j < n; ++j) {
      const std::uint8_t* r = planes[j].channel[0].ptr<std::uint8_t>(y);
      const std::uint8_t* g = planes[j].channel[1].ptr<std::uint8_t>(y);
      const std::uint8_t* b = planes[j].channel[2].ptr<std::uint8_t>(y);
      const std::uint8_t* usable = planes[j].usable.ptr<std::uint8_t>(y);
      std::uint8_t* v = votes.data();
      for (int x = 0; x < width; ++x) {
        const int dr = std::abs(r[x] - r0[x]), dg = std::abs(g[x] - g0[x]), db = std::abs(b[x] - b0[x]);
        const int far = std::max(std::max(dr, dg), db);
        v[x] = static_cast<std::uint8_t>(v[x] + (far < kSameColor ? usable[x] & own[x] : 0));
      }
    }
    for (std::size_t x = 0; x < votes.size(); ++x) {
      if (votes[x] > best[x]) best[x] = votes[x], winner[x] = static_cast<std::uint8_t>(i);
      const int away = DistanceFromMedian(planes[i], middle, static_cast<int>(x), y);
      if (votes[x] > 0 && away < nearest[x]) {
        nearest[x] = static_cast<std::uint8_t>(away);
        at_median[x] = static_cast<std::uint8_t>(i);
        median_votes[x] = votes[x];
      }
    }
  }
  // Things that people put down and take up again have no single colour: between the largest cluster and a
  // median's that is a quarter as large, the median stays.
  for (std::size_t x = 0; x < votes.size(); ++x) {
    if (4 * median_votes[x] >= best[x]) winner[x] = at_median[x];
  }
  for (int x = 0; x < width; ++x) {
    const Planes& center = planes[winner[static_cast<std::size_t>(x)]];
    float count = 0;
    std::array<float, 3> sum{}, square{};
    for (const Planes& sample : planes) {
      bool near = best[static_cast<std::size_t>(x)] == 0 || sample.usable(y, x) != 0;
      for (std::size_t c = 0; c < 3; ++c) {
        near = near && std::abs(sample.channel[c](y, x) - center.channel[c](y, x)) < kSameColor;
      }
      if (!near) continue;
      ++count;
      for (std::size_t c = 0; c < 3; ++c) {
        const auto value = static_cast<float>(sample.channel[c](y, x));
        sum[c] += value;
        square[c] += value * value;
      }
    }
    for (std::size_t c = 0; c < 3; ++c) {
      const float mean = sum[c] / std::max(count, 1.0f);
      s->mean[c](y, x) = mean;
      s->sigma[c](y, x) = std::sqrt(std::max(square[c] / std::max(count, 1.0f) - mean * mean, 0.0f));
    }
  }
}

}  // namespace

void FarthestDepth(std::span<const BackgroundEstimator::Sample> samples, float far_share, RoomStatistics* s) {
  cv::Size size;
  std::size_t frames = 0;
  for (const auto& sample : samples) {
    if (sample.depth_m.empty()) continue;
    size = sample.depth_m.size();
    ++frames;
  }
  if (frames < 3) return;
  const auto need =
      std::max<std::size_t>(3, static_cast<std::size_t>(std::ceil(far_share * static_cast<float>(frames))));
  for (cv::Mat1f* plane : {&s->depth_m, &s->depth_sigma_m, &s->depth_share}) {
    plane->create(size);
    plane->setTo(0);
  }
  std::vector<float> values;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      values.clear();
      for (const auto& sample : samples) {
        if (!sample.depth_m.empty() && sample.depth_m(y, x) > 0) values.push_back(sample.depth_m(y, x));
      }
      std::sort(values.begin(), values.end(), std::greater<>());
      for (std::size_t i = 0; i + need <= values.size(); ++i) {
        if (values[i] - values[i + need - 1] > SameSurface_m(values[i])) continue;
        const float middle = values[i + need / 2];
        const auto first = std::find_if(values.begin(), values.end(),
                                        [&](float z) { return z < middle + SameSurface_m(middle); });
        const auto last =
            std::find_if(first, values.end(), [&](float z) { return z < middle - SameSurface_m(middle); });
        const float room = *(first + (last - first) / 2);
        std::vector<float> spread;
        for (auto it = first; it != last; ++it) spread.push_back(std::abs(*it - room));
        std::nth_element(spread.begin(), spread.begin() + static_cast<std::ptrdiff_t>(spread.size() / 2),
                         spread.end());
        s->depth_m(y, x) = room;
        s->depth_sigma_m(y, x) = 1.4826f * spread[spread.size() / 2];
        s->depth_share(y, x) = static_cast<float>(last - first) / static_cast<float>(frames);
        break;
      }
    }
  }
}

void MostFrequentColor(std::span<const BackgroundEstimator::Sample> samples, RoomStatistics* s) {
  std::array<cv::Mat1f, 3> reference = FirstReference(samples);
  for (std::size_t c = 0; c < 3; ++c) {
    s->mean[c].create(reference[c].size());
    s->sigma[c].create(reference[c].size());
  }
  // The tone changes are found against the reference, which the vote then improves: twice is enough.
  for (int round = 0; round < 2; ++round) {
    std::vector<Planes> planes(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const HalfPicture& picture = samples[i].picture;
      const cv::Mat1b front = InFront(samples[i], s->depth_m);
      const ToneChange tone = FindToneChange(picture, reference, front);
      planes[i].channel[0] = RemoveTone(picture.r, tone.gain[0], tone.offset[0]);
      planes[i].channel[1] = RemoveTone(picture.g, tone.gain[1], tone.offset[1]);
      planes[i].channel[2] = RemoveTone(picture.b, tone.gain[2], tone.offset[2]);
      cv::threshold(front, planes[i].usable, 0, 1, cv::THRESH_BINARY_INV);
    }
    for (int y = 0; y < s->mean[0].rows; ++y) VoteRow(planes, y, s);
    for (std::size_t c = 0; c < 3; ++c) reference[c] = s->mean[c];
  }
}

}  // namespace mixstage
