// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/blurred_pattern.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

double Density(double x) { return 0.3989422804014327 * std::exp(-0.5 * x * x); }
double SignMean(double x) { return std::erf(x * (1 / std::numbers::sqrt2)); }  // of sign(x + N(0, 1))

}  // namespace

PatternValue BlurredPattern(const Board& board, const Eigen::Vector2d& place,
                            const Eigen::Matrix2d& squares_by_pixel, double spot_px) {
  const double column = std::clamp(std::round(place.x()), 0.0, board.columns - 1.0);
  const double row = std::clamp(std::round(place.y()), 0.0, board.rows - 1.0);
  const double length_x = squares_by_pixel.row(0).norm();
  const double length_y = squares_by_pixel.row(1).norm();
  const double h = (place.x() - column) / (spot_px * length_x);
  const double k = (place.y() - row) / (spot_px * length_y);
  const double rho = squares_by_pixel.row(0).dot(squares_by_pixel.row(1)) / (length_x * length_y);
  constexpr double kFar = 4.5;  // beyond it an edge is flat
  PatternValue value;
  const bool corner = std::abs(h) < kFar && std::abs(k) < kFar;
  if (corner && std::abs(rho) > 0.75) return value;
  const double sign_h = SignMean(h);
  const double sign_k = SignMean(k);
  const double density_h = Density(h);
  const double density_k = Density(k);
  double mean = sign_h * sign_k;
  double mean_h = 2 * density_h * sign_k;
  double mean_k = 2 * density_k * sign_h;
  if (corner) {
    const double root = std::sqrt(1 - rho * rho);
    mean_h = 2 * density_h * SignMean((k - rho * h) / root);
    mean_k = 2 * density_k * SignMean((h - rho * k) / root);
    // Hermite polynomials of h and of k by their recurrence.
    double h0 = 1;
    double h1 = h;
    double k0 = 1;
    double k1 = k;
    double factor = rho;  // rho^n / n!
    double sum = 0;
    for (int n = 1; n <= 12; ++n) {
      sum += factor * h0 * k0;
      factor *= rho / (n + 1);
      const double h2 = h * h1 - n * h0;
      const double k2 = k * k1 - n * k0;
      h0 = h1;
      h1 = h2;
      k0 = k1;
      k1 = k2;
    }
    mean += 4 * density_h * density_k * sum;
  }
  // Square (column, row), right of and below its lines, is black where the sum of its numbers is even
  // (board.h).
  const double white = static_cast<int>(column + row) % 2 == 0 ? -0.5 : 0.5;
  value.white = std::clamp(0.5 + white * mean, 0.0, 1.0);
  value.by_place << white * mean_h / (spot_px * length_x), white * mean_k / (spot_px * length_y);
  value.by_spot = -white * (mean_h * h + mean_k * k) / spot_px;
  value.known = true;
  return value;
}

}  // namespace mixstage
