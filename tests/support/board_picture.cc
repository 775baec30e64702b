// SPDX-License-Identifier: Apache-2.0
#include "tests/support/board_picture.h"

#include <cmath>
#include <numbers>
#include <random>

namespace mixstage {
namespace {

// Brightness of a board's plane at (x, y), squares; nothing beside the board.
std::optional<double> Paint(const Board& b, double x, double y, const BoardPictureLook& look) {
  const double margin = b.white_margin_m / b.square_m;
  if (x < -1 - margin || y < -1 - margin || x > b.columns + margin || y > b.rows + margin)
    return std::nullopt;
  if (x < -1 || y < -1 || x > b.columns || y > b.rows) return look.white;
  const auto c = static_cast<int>(std::floor(x));
  const auto r = static_cast<int>(std::floor(y));
  return (c + r) % 2 == 0 ? look.black : look.white;
}

template <typename Camera, typename Ray>
cv::Mat1f Draw(const Camera& camera, const std::vector<PlacedBoard>& boards, const BoardPictureLook& look,
               Ray ray_of) {
  constexpr int kSide = 7;         // strata of the spot in x and in y
  constexpr int kQuantiles = 512;  // of a Gaussian, by bisection
  std::array<double, kQuantiles> quantiles{};
  for (int i = 0; i < kQuantiles; ++i) {
    double low = -5;
    double high = 5;
    for (int k = 0; k < 40; ++k) {
      const double middle = 0.5 * (low + high);
      (0.5 * std::erfc(-middle / std::numbers::sqrt2) < (i + 0.5) / kQuantiles ? low : high) = middle;
    }
    quantiles[static_cast<std::size_t>(i)] = low;
  }
  std::vector<RigidTransform> T_board_camera;
  for (const PlacedBoard& b : boards) T_board_camera.push_back(b.T_camera_board.inverse());
  auto brightness = [&](double u, double v) {
    const auto ray = ray_of(u, v);
    if (!ray) return 0.0;
    for (std::size_t i = 0; i < boards.size(); ++i) {
      const Eigen::Vector3d o = T_board_camera[i].translation();
      const Eigen::Vector3d d = T_board_camera[i].linear() * *ray;
      const double t = -o.z() / d.z();
      if (!(t > 0)) continue;
      const double s = boards[i].board.square_m;
      if (auto p = Paint(boards[i].board, (o.x() + t * d.x()) / s, (o.y() + t * d.y()) / s, look))
        return *p * (1 - look.slope * u / camera.width);
    }
    return look.behind;
  };
  std::mt19937_64 random(look.seed);
  std::normal_distribution<double> noise(0, 1);
  // A ray at a random place of its stratum: a fixed grid would make steps of its own along edges.
  auto offset = [&](int stratum) {
    const int first = stratum * kQuantiles / kSide;
    const int end = (stratum + 1) * kQuantiles / kSide;
    const auto pick = static_cast<int>(random() % static_cast<std::uint64_t>(end - first));
    return look.spot_px * quantiles[static_cast<std::size_t>(first + pick)];
  };
  cv::Mat1f picture(camera.height, camera.width);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      double sum = 0;
      for (int i = 0; i < kSide * kSide; ++i) sum += brightness(u + offset(i % kSide), v + offset(i / kSide));
      picture(v, u) = static_cast<float>(sum / (kSide * kSide) + look.noise * noise(random));
    }
  }
  return picture;
}

}  // namespace

cv::Mat1f DrawBoards(const PinholeCamera& camera, const std::vector<PlacedBoard>& boards,
                     const BoardPictureLook& look) {
  return Draw(camera, boards, look, [&](double u, double v) -> std::optional<Eigen::Vector3d> {
    const auto p = camera.Unproject({u, v});
    if (!p) return std::nullopt;
    return Eigen::Vector3d(p->x(), p->y(), 1);
  });
}

cv::Mat1f DrawBoards(const FisheyeCamera& camera, const std::vector<PlacedBoard>& boards,
                     const BoardPictureLook& look) {
  return Draw(camera, boards, look, [&](double u, double v) { return camera.Unproject({u, v}); });
}

cv::Mat1b ToSrgb8(const cv::Mat1f& linear) {
  cv::Mat1b out(linear.size());
  for (int v = 0; v < linear.rows; ++v) {
    for (int u = 0; u < linear.cols; ++u) {
      const double x = std::max(0.0f, linear(v, u));
      const double s = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
      out(v, u) = cv::saturate_cast<std::uint8_t>(255 * s);
    }
  }
  return out;
}

RigidTransform BoardAt(const Board& board, double distance_m, double turn_x_deg, double turn_y_deg,
                       double turn_z_deg, double shift_x_m, double shift_y_m) {
  constexpr double kRad = std::numbers::pi / 180;
  RigidTransform T = RigidTransform::Identity();
  T.linear() = (Eigen::AngleAxisd(turn_z_deg * kRad, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(turn_y_deg * kRad, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(turn_x_deg * kRad, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  const Eigen::Vector3d middle(0.5 * board.square_m * (board.columns - 1),
                               0.5 * board.square_m * (board.rows - 1), 0);
  T.translation() = Eigen::Vector3d(shift_x_m, shift_y_m, distance_m) - T.linear() * middle;
  return T;
}

}  // namespace mixstage
