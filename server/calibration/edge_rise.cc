// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/edge_rise.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mixstage {
namespace {

using Eigen::Vector2d;

constexpr int kSamples = 91;  // across an edge, from -0.45 to +0.45 squares

double Bilinear(const cv::Mat1b& picture, const Vector2d& p) {
  const int u = static_cast<int>(std::floor(p.x()));
  const int v = static_cast<int>(std::floor(p.y()));
  if (u < 0 || v < 0 || u + 1 >= picture.cols || v + 1 >= picture.rows) return std::nan("");
  const double s = p.x() - u;
  const double t = p.y() - v;
  return (1 - t) * ((1 - s) * picture(v, u) + s * picture(v, u + 1)) +
         t * ((1 - s) * picture(v + 1, u) + s * picture(v + 1, u + 1));
}

}  // namespace

double EdgeRise(const cv::Mat1b& picture, const Board& board, const std::vector<Vector2d>& pixels) {
  auto at = [&](int c, int r) { return pixels[static_cast<std::size_t>(r * board.columns + c)]; };
  std::array<double, kSamples> mean{};  // of all edges, each from its dark to its bright side
  double length = 0;                    // px from the first to the last sample
  int edges = 0;
  for (int r = 1; r + 1 < board.rows; ++r) {
    for (int c = 0; c + 1 < board.columns; ++c) {
      const Vector2d middle = 0.5 * (at(c, r) + at(c + 1, r));
      const Vector2d along = (at(c + 1, r) - at(c, r)).normalized();
      Vector2d across = 0.25 * (at(c, r + 1) + at(c + 1, r + 1) - at(c, r - 1) - at(c + 1, r - 1));
      across -= along * along.dot(across);
      std::array<double, kSamples> profile{};
      bool whole = true;
      for (int i = 0; i < kSamples; ++i) {
        const double t = 0.9 * i / (kSamples - 1) - 0.45;
        profile[static_cast<std::size_t>(i)] = Bilinear(picture, middle + t * across);
        whole = whole && std::isfinite(profile[static_cast<std::size_t>(i)]);
      }
      const double step = profile.back() - profile.front();
      if (!whole || std::abs(step) < 8) continue;
      for (int i = 0; i < kSamples; ++i) {
        const int from = step > 0 ? i : kSamples - 1 - i;
        mean[static_cast<std::size_t>(i)] += profile[static_cast<std::size_t>(from)];
      }
      length += 0.9 * across.norm();
      ++edges;
    }
  }
  if (edges < 3) return 0;
  length /= edges;
  // Less than a tenth of the steepest gradient is shading, not the edge.
  double steepest = 0;
  for (std::size_t i = 0; i + 1 < mean.size(); ++i) steepest = std::max(steepest, mean[i + 1] - mean[i]);
  double sum = 0;
  double second = 0;
  for (int i = 0; i + 1 < kSamples; ++i) {
    const double gradient = mean[static_cast<std::size_t>(i) + 1] - mean[static_cast<std::size_t>(i)];
    if (gradient < 0.1 * steepest) continue;
    const double x = length * ((i + 0.5) / (kSamples - 1) - 0.5);
    sum += gradient;
    second += gradient * x * x;
  }
  // Bilinear sampling adds 1/6 px^2.
  const double variance = second / sum - 1.0 / 6;
  return sum > 0 && variance > 0 ? 2.563 * std::sqrt(variance) : 0;
}

}  // namespace mixstage
