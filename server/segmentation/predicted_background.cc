// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/predicted_background.h"

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"
#include "proto/base/median.h"
#include "server/segmentation/box_mean.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {
namespace {

constexpr float kSigmaOfMedian = 1.4826f;  // of a Gaussian's absolute values
constexpr std::size_t kFewestPixels = 60;
constexpr float kLeastColorSigma = 0.8f;  // 8 bit, JPEG
constexpr float kUsualColorSigma = 3.0f;
constexpr float kLeastDepthSigma_m = 0.004f;
constexpr float kUsualDepthSigmaPerMetre = 0.015f;
// Squared grey levels from a pixel to the next: below, half a pixel of misplacement is less than the noise;
// above, it is what counts.
constexpr float kPlain = 2.0f, kPatterned = 60.0f;
constexpr float kInFront = 4.0f;            // sigmas from which on depth says: not the room
constexpr float kFilledVariance = 60 * 60;  // the next surface's colour, continued
constexpr float kUnknownVariance = 1e5f;    // any colour is as good as any other

int LevelOf(int brightness) { return brightness * PredictionNoise::kLevels / 256; }
int DistanceOf(float z_m) { return std::min(static_cast<int>(2 * z_m), PredictionNoise::kDistances - 1); }

std::array<const cv::Mat1b*, 3> Channels(const RoomPrediction& room) { return {&room.r, &room.g, &room.b}; }
std::array<const cv::Mat1b*, 3> Channels(const HalfPicture& picture) {
  return {&picture.r, &picture.g, &picture.b};
}

// [Half(h) x Half(w)] Squared difference between neighbouring pixels, of the channel where it is greatest,
// over 3x3.
void ContrastOf(const RoomPrediction& room, cv::Mat1f* contrast) {
  const cv::Size size = room.r.size();
  contrast->create(size);
  contrast->setTo(0);
  for (const cv::Mat1b* channel : Channels(room)) {
    for (int y = 0; y < size.height; ++y) {
      const std::uint8_t* here = channel->ptr<std::uint8_t>(y);
      const std::uint8_t* below = channel->ptr<std::uint8_t>(std::min(y + 1, size.height - 1));
      float* out = contrast->ptr<float>(y);
      for (int x = 0; x + 1 < size.width; ++x) {
        const int dx = here[x + 1] - here[x];
        const int dy = below[x] - here[x];
        out[x] = std::max(out[x], static_cast<float>(dx * dx + dy * dy));
      }
    }
  }
  MeanOf3x3(contrast);
}

// Fills gaps from the nearest that is known.
template <std::size_t N>
void FillGaps(std::array<float, N>& values) {
  const auto known = values;
  for (int i = 0; i < static_cast<int>(N); ++i) {
    for (int reach = 0; reach < static_cast<int>(N) && values[static_cast<std::size_t>(i)] == 0; ++reach) {
      for (const int j : {i - reach, i + reach}) {
        if (j >= 0 && j < static_cast<int>(N) && known[static_cast<std::size_t>(j)] > 0)
          values[static_cast<std::size_t>(i)] = known[static_cast<std::size_t>(j)];
      }
    }
  }
}

}  // namespace

void PredictionNoise::Add(const RoomPrediction& room, const HalfPicture& picture,
                          ImageView<const float> depth_m) {
  MIX_CHECK(room.r.size() == picture.r.size());
  MIX_CHECK(depth_m.empty() || (depth_m.width() == room.width && depth_m.height() == room.height));
  if (complete()) return;
  ++frames_;

  // Depth first: what stands in front of the room is left out of the colours.
  std::array<std::vector<float>, kDistances> distances;
  if (!depth_m.empty()) {
    for (int y = 1; y < room.height; y += 4) {
      for (int x = 1; x < room.width; x += 4) {
        const float D = depth_m.at(x, y);
        const float D_M = room.depth_m(y, x);
        // Whoever acts stands in front of the room, never behind it: that side alone is noise.
        if (D_M > 0 && D >= D_M) distances[static_cast<std::size_t>(DistanceOf(D_M))].push_back(D - D_M);
      }
    }
    for (std::size_t i = 0; i < distances.size(); ++i) {
      if (distances[i].size() >= kFewestPixels)
        depth_seen_[i].push_back(kSigmaOfMedian * Median(distances[i]));
    }
  }
  Summarise();

  std::array<cv::Mat1f, 3> mean;
  for (std::size_t c = 0; c < 3; ++c) Channels(room)[c]->convertTo(mean[c], CV_32F);
  const ToneChange tone = FindToneChange(picture, mean, cv::Mat1b());
  cv::Mat1f contrast;
  ContrastOf(room, &contrast);
  std::array<std::array<std::vector<float>, kLevels>, 3> levels;
  std::vector<float> squares;  // of errors, where the room is patterned: beyond the plain noise, per contrast
  struct Error {
    float error, variance_of_contrast;
    int brightness;
    std::size_t channel;
  };
  std::vector<Error> patterned;
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = y % 2; x < picture.width(); x += 2) {
      if (room.seen(y, x) != RoomPrediction::kSeen) continue;
      const int u = std::min(2 * x, room.width - 1);
      const int v = std::min(2 * y, room.height - 1);
      if (!depth_m.empty() && depth_m.at(u, v) > 0 &&
          room.depth_m(v, u) - depth_m.at(u, v) > kInFront * depth_sigma_m(room.depth_m(v, u))) {
        continue;
      }
      for (std::size_t c = 0; c < 3; ++c) {
        const float I_m = mean[c](y, x);
        const float I_t = (*Channels(picture)[c])(y, x);
        const float error = std::abs(I_t - tone.gain[c] * I_m - tone.offset[c]);
        const int brightness = static_cast<int>(I_m);
        if (contrast(y, x) < kPlain) {
          levels[c][static_cast<std::size_t>(LevelOf(brightness))].push_back(error);
        } else if (contrast(y, x) > kPatterned) {
          patterned.push_back({error, contrast(y, x), brightness, c});
        }
      }
    }
  }
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < kLevels; ++i) {
      if (levels[c][i].size() >= kFewestPixels)
        color_seen_[c][i].push_back(kSigmaOfMedian * Median(levels[c][i]));
    }
  }
  Summarise();
  for (const Error& e : patterned) {
    const float plain = color_sigma(e.channel, e.brightness);
    const float square = kSigmaOfMedian * kSigmaOfMedian * e.error * e.error;
    squares.push_back((square - plain * plain) / e.variance_of_contrast);
  }
  if (squares.size() >= kFewestPixels)
    per_contrast_seen_.push_back(std::sqrt(std::max(Median(squares), 0.0f)));
  Summarise();
}

void PredictionNoise::Summarise() {
  color_ = {};
  depth_ = {};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < kLevels; ++i) {
      if (!color_seen_[c][i].empty()) color_[c][i] = std::max(kLeastColorSigma, Median(color_seen_[c][i]));
    }
    FillGaps(color_[c]);
  }
  for (std::size_t i = 0; i < kDistances; ++i) {
    if (!depth_seen_[i].empty()) depth_[i] = std::max(kLeastDepthSigma_m, Median(depth_seen_[i]));
  }
  FillGaps(depth_);
  if (!per_contrast_seen_.empty()) per_contrast_ = Median(per_contrast_seen_);
}

float PredictionNoise::color_sigma(std::size_t channel, int brightness) const {
  const float sigma = color_[channel][static_cast<std::size_t>(LevelOf(brightness))];
  return sigma > 0 ? sigma : kUsualColorSigma;
}

float PredictionNoise::depth_sigma_m(float z_m) const {
  const float sigma = depth_[static_cast<std::size_t>(DistanceOf(z_m))];
  return sigma > 0 ? sigma : std::max(kLeastDepthSigma_m, kUsualDepthSigmaPerMetre * z_m);
}

void PredictBackground(const RoomPrediction& room, const PredictionNoise& noise, const PredictionDoubt& doubt,
                       BackgroundModel* model) {
  MIX_CHECK(model != nullptr && !room.r.empty());
  model->width = room.width;
  model->height = room.height;
  model->seen = room.seen;
  const cv::Size size = room.r.size();
  cv::Mat1f contrast;
  ContrastOf(room, &contrast);
  const float per_contrast = noise.per_contrast().value_or(0.5f * doubt.registration_px);
  std::array<float, 256> doubt_of{};  // by RoomPrediction::seen
  doubt_of.fill(kUnknownVariance);
  doubt_of[RoomPrediction::kSeen] = 0;
  doubt_of[RoomPrediction::kFilled] = kFilledVariance;
  for (std::size_t c = 0; c < 3; ++c) {
    std::array<float, 256> sensor{};  // variance by brightness
    for (int i = 0; i < 256; ++i) {
      const float sigma = noise.color_sigma(c, i);
      sensor[static_cast<std::size_t>(i)] = sigma * sigma;
    }
    model->mean[c].create(size);
    model->variance[c].create(size);
    for (int y = 0; y < size.height; ++y) {
      const std::uint8_t* from = Channels(room)[c]->ptr<std::uint8_t>(y);
      const std::uint8_t* seen = room.seen.ptr<std::uint8_t>(y);
      const float* square = contrast.ptr<float>(y);
      float* mean = model->mean[c].ptr<float>(y);
      float* variance = model->variance[c].ptr<float>(y);
      for (int x = 0; x < size.width; ++x) {
        mean[x] = from[x];
        variance[x] = doubt_of[seen[x]] + sensor[from[x]] + per_contrast * per_contrast * square[x];
      }
    }
  }
  FinishColor(model);

  QuarterDepth(View(room.depth_m), &model->room_depth_m);
  model->sigma_m.create(model->room_depth_m.size());
  for (int y = 0; y < model->room_depth_m.rows; ++y) {
    for (int x = 0; x < model->room_depth_m.cols; ++x) {
      const float z = model->room_depth_m(y, x);
      model->sigma_m(y, x) = z > 0 ? std::hypot(noise.depth_sigma_m(z), doubt.depth_sigma_m) : 0.0f;
    }
  }
  FinishDepth(cv::Mat1f(model->room_depth_m.size(), 1.0f), model);
}

}  // namespace mixstage
