// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_picture_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "proto/base/median.h"

#include "server/calibration/blurred_pattern.h"
#include "server/calibration/lens_jacobian.h"

namespace mixstage {
namespace {

constexpr int kLight = 12;            // white and black, six numbers each
constexpr double kReach_spots = 3.5;  // from an edge
constexpr std::size_t kFewestPixels = 200;

using Light = Eigen::Matrix<double, kLight, 1>;

Eigen::Matrix3d Cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// R(w + d) = R(w) R(J d) to first order.
Eigen::Matrix3d RightJacobian(const Eigen::Vector3d& w) {
  const double a = w.norm();
  const Eigen::Matrix3d W = Cross(w);
  if (a < 1e-6) return Eigen::Matrix3d::Identity() - 0.5 * W;
  return Eigen::Matrix3d::Identity() - (1 - std::cos(a)) / (a * a) * W +
         (a - std::sin(a)) / (a * a * a) * W * W;
}

PoseNumbers PoseAt(const double* numbers) {
  PoseNumbers pose;
  std::copy(numbers, numbers + 6, pose.begin());
  return pose;
}

}  // namespace

Eigen::Matrix<double, 6, 1> BoardPictureFit::LightBasis(const Pixel& p) const {
  const double x = (p.u - middle_.x()) / extent_;
  const double y = (p.v - middle_.y()) / extent_;
  return {1, x, y, x * x, x * y, y * y};
}

void BoardPictureFit::Select(const cv::Mat1f& brightness, const Lens& lens,
                             const RigidTransform& T_camera_board) {
  // The board's outline in the picture, walked along its outer squares.
  double u0 = 1e9;
  double v0 = 1e9;
  double u1 = -1e9;
  double v1 = -1e9;
  for (int c = -2; c <= 2 * board_.columns; ++c) {
    for (int r = -2; r <= 2 * board_.rows; ++r) {
      const auto p = lens.Project(T_camera_board *
                                  Eigen::Vector3d(0.5 * c * board_.square_m, 0.5 * r * board_.square_m, 0));
      if (!p) continue;
      u0 = std::min(u0, p->x());
      v0 = std::min(v0, p->y());
      u1 = std::max(u1, p->x());
      v1 = std::max(v1, p->y());
    }
  }
  const RigidTransform T_board_camera = T_camera_board.inverse();
  const Eigen::Vector3d origin = T_board_camera.translation() / board_.square_m;
  const Eigen::Matrix<double, 3, 2> along = T_camera_board.linear().leftCols<2>() * board_.square_m;
  LensJacobian jacobian;
  for (int v = std::max(1, int(v0)); v <= std::min(brightness.rows - 2, int(v1) + 1); ++v) {
    for (int u = std::max(1, int(u0)); u <= std::min(brightness.cols - 2, int(u1) + 1); ++u) {
      const auto ray = lens.Unproject({u, v});
      if (!ray) continue;
      const Eigen::Vector3d direction = T_board_camera.linear() * *ray;
      const double distance = -origin.z() / direction.z();
      if (!(distance > 0)) continue;
      const Eigen::Vector2d place = (origin + distance * direction).head<2>();
      if (place.x() < -1 || place.y() < -1 || place.x() > board_.columns || place.y() > board_.rows) continue;
      ProjectWithPoint(
          kind_, lens.numbers.data(),
          T_camera_board * Eigen::Vector3d(place.x() * board_.square_m, place.y() * board_.square_m, 0),
          jacobian);
      const Eigen::Matrix2d squares_by_pixel = (jacobian.by_point * along).inverse();
      // Per square, px across the line: 1 / |row|.
      const Eigen::Vector2d line(std::clamp(std::round(place.x()), 0.0, board_.columns - 1.0),
                                 std::clamp(std::round(place.y()), 0.0, board_.rows - 1.0));
      const Eigen::Vector2d across((place.x() - line.x()) / squares_by_pixel.row(0).norm(),
                                   (place.y() - line.y()) / squares_by_pixel.row(1).norm());
      const double reach = kReach_spots * spot_px_ + 0.7;
      if (across.cwiseAbs().minCoeff() > reach) continue;
      // The outer squares' outer edges stay out: what is beyond them is not known.
      const double border_x =
          std::min(place.x() + 1, board_.columns - place.x()) / squares_by_pixel.row(0).norm();
      const double border_y =
          std::min(place.y() + 1, board_.rows - place.y()) / squares_by_pixel.row(1).norm();
      if (std::min(border_x, border_y) < reach) continue;
      pixels_.push_back({float(u), float(v), brightness(v, u), 1.0f, place.cast<float>()});
    }
  }
  if (pixels_.empty()) return;
  middle_ = 0.5 * Eigen::Vector2d(u0 + u1, v0 + v1);
  extent_ = 0.5 * std::max(u1 - u0, v1 - v0);
}

template <typename Each>
void BoardPictureFit::ForEach(const FitNumbers& numbers, Each each) const {
  const RigidTransform T_camera_board =
      TransformOf(PoseAt(numbers.first_camera)).inverse() * TransformOf(PoseAt(numbers.first_board));
  const Eigen::Matrix<double, 3, 2> along = T_camera_board.linear().leftCols<2>() * board_.square_m;
  LensJacobian jacobian;
  for (const Pixel& p : pixels_) {
    Eigen::Vector2d place = p.place.cast<double>();
    Eigen::Matrix2d squares_by_pixel;
    for (int i = 0; i < 4; ++i) {
      ProjectWithPoint(kind_, numbers.lens, along * place + T_camera_board.translation(), jacobian);
      squares_by_pixel = (jacobian.by_point * along).inverse();
      const Eigen::Vector2d step = squares_by_pixel * (Eigen::Vector2d(p.u, p.v) - jacobian.pixel);
      place += step;
      if (step.squaredNorm() < 1e-10) break;
    }
    if (!place.allFinite()) continue;
    const PatternValue pattern = BlurredPattern(board_, place, squares_by_pixel, spot_px_);
    if (pattern.known) each(p, pattern, squares_by_pixel, place);
  }
}

bool BoardPictureFit::Weigh(const FitNumbers& numbers) {
  // Light and the spot's change, by weighted least squares; twice, for the spot is not linear.
  Light light = Light::Zero();
  for (int round = 0; round < 3; ++round) {
    Eigen::Matrix<double, kLight + 1, kLight + 1> A = Eigen::Matrix<double, kLight + 1, kLight + 1>::Zero();
    Eigen::Matrix<double, kLight + 1, 1> b = Eigen::Matrix<double, kLight + 1, 1>::Zero();
    ForEach(numbers,
            [&](const Pixel& p, const PatternValue& pattern, const Eigen::Matrix2d&, const Eigen::Vector2d&) {
              const Eigen::Matrix<double, 6, 1> basis = LightBasis(p);
              Eigen::Matrix<double, kLight + 1, 1> row;
              const double contrast = basis.dot(light.head<6>() - light.tail<6>());
              row << pattern.white * basis, (1 - pattern.white) * basis, contrast * pattern.by_spot;
              A.selfadjointView<Eigen::Lower>().rankUpdate(row, p.weight);
              b += p.weight * p.brightness * row;
            });
    A.diagonal().array() += 1e-9 * (A.diagonal().maxCoeff() + 1e-12);
    // In the first round there is no light yet and the last column is zero: its solution too.
    const Eigen::Matrix<double, kLight + 1, 1> x = A.selfadjointView<Eigen::Lower>().ldlt().solve(b);
    if (!x.allFinite()) return false;
    light = x.head<kLight>();
    if (round > 0) spot_px_ = std::clamp(spot_px_ + std::clamp(x(kLight), -0.3, 0.3), 0.25, 6.0);
  }
  // Noise of black and of white by the median; weights by how far a pixel is off.
  std::vector<double> residuals(pixels_.size(), 0);
  std::vector<double> whites(pixels_.size(), -1);
  std::vector<double> dark;
  std::vector<double> bright;
  std::vector<double> between;
  double contrast = 0;
  std::size_t used = 0;
  ForEach(numbers, [&](const Pixel& p, const PatternValue& pattern, const Eigen::Matrix2d&,
                       const Eigen::Vector2d&) {
    const Eigen::Matrix<double, 6, 1> basis = LightBasis(p);
    const double white = basis.dot(light.head<6>());
    const double black = basis.dot(light.tail<6>());
    const auto i = static_cast<std::size_t>(&p - pixels_.data());
    residuals[i] = p.brightness - (pattern.white * white + (1 - pattern.white) * black);
    whites[i] = pattern.white;
    (pattern.white < 0.1 ? dark : pattern.white > 0.9 ? bright : between).push_back(std::abs(residuals[i]));
    contrast += white - black;
    ++used;
  });
  if (used < kFewestPixels || dark.size() < 30 || bright.size() < 30 || between.size() < 30) return false;
  contrast /= static_cast<double>(used);
  const double sigma_dark = std::max(1.4826 * Median(dark), 1e-4 * contrast);
  const double sigma_bright = std::max(1.4826 * Median(bright), 1e-4 * contrast);
  const double sigma_between = 1.4826 * Median(between);
  // What edges have beyond the noise of their sides: the spot is no Gaussian.
  const double side = std::sqrt(0.5 * (sigma_dark * sigma_dark + sigma_bright * sigma_bright));
  const double extra = std::max(0.0, sigma_between * sigma_between - side * side);
  double squares = 0;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const double w = whites[i];
    if (w < 0) {
      pixels_[i].weight = 0;
      continue;
    }
    const double variance =
        (1 - w) * sigma_dark * sigma_dark + w * sigma_bright * sigma_bright + 4 * w * (1 - w) * extra;
    const double size = std::abs(residuals[i]) / std::sqrt(variance);
    pixels_[i].weight = static_cast<float>(size > 8 ? 0 : std::min(1.0, 4 / size) / variance);
    squares += std::min(residuals[i] * residuals[i], contrast * contrast);
  }
  misfit_ = std::sqrt(squares / static_cast<double>(used)) / std::abs(contrast);
  return contrast > 0 && misfit_ < 0.25 && contrast > 5 * side;
}

std::optional<BoardPictureFit> BoardPictureFit::Prepare(const cv::Mat1f& brightness, const Lens& lens,
                                                        const Board& board,
                                                        const RigidTransform& T_first_camera,
                                                        const RigidTransform& T_first_board) {
  BoardPictureFit fit(lens.kind, board);
  const PoseNumbers camera = NumbersOf(T_first_camera);
  const PoseNumbers place = NumbersOf(T_first_board);
  const FitNumbers numbers{lens.numbers.data(), camera.data(), place.data()};
  // The spot decides which pixels are near edges: twice.
  for (int round = 0; round < 2; ++round) {
    fit.pixels_.clear();
    fit.Select(brightness, lens, T_first_camera.inverse() * T_first_board);
    if (fit.pixels_.size() < kFewestPixels || !fit.Weigh(numbers) || !fit.Weigh(numbers)) return std::nullopt;
  }
  std::erase_if(fit.pixels_, [](const Pixel& p) { return p.weight <= 0; });
  return fit;
}

void BoardPictureFit::Accumulate(const FitNumbers& numbers, FitNormal& normal) const {
  // With the light of these numbers, which is linear: first it, then the residuals.
  Eigen::Matrix<double, kLight, kLight> A = Eigen::Matrix<double, kLight, kLight>::Zero();
  Light b = Light::Zero();
  struct Sample {
    const Pixel* pixel;
    PatternValue pattern;
    Eigen::Matrix2d squares_by_pixel;
    Eigen::Vector2d place;
  };
  std::vector<Sample> samples;
  samples.reserve(pixels_.size());
  Light row;
  ForEach(numbers, [&](const Pixel& p, const PatternValue& pattern, const Eigen::Matrix2d& m,
                       const Eigen::Vector2d& place) {
    const Eigen::Matrix<double, 6, 1> basis = LightBasis(p);
    row << pattern.white * basis, (1 - pattern.white) * basis;
    A.selfadjointView<Eigen::Lower>().rankUpdate(row, p.weight);
    b += p.weight * p.brightness * row;
    samples.push_back({&p, pattern, m, place});
  });
  A.diagonal().array() += 1e-9 * (A.diagonal().maxCoeff() + 1e-12);
  const Eigen::LDLT<Eigen::Matrix<double, kLight, kLight>, Eigen::Lower> light_solver(A);
  const Light light = light_solver.solve(b);

  const RigidTransform T_first_camera = TransformOf(PoseAt(numbers.first_camera));
  const RigidTransform T_first_board = TransformOf(PoseAt(numbers.first_board));
  const Eigen::Matrix3d R_camera_first = T_first_camera.linear().transpose();
  const Eigen::Vector3d w_camera(numbers.first_camera[0], numbers.first_camera[1], numbers.first_camera[2]);
  const Eigen::Vector3d w_board(numbers.first_board[0], numbers.first_board[1], numbers.first_board[2]);
  const Eigen::Matrix3d by_board_turn = -R_camera_first * T_first_board.linear();  // [X]x J behind it
  const Eigen::Matrix3d J_board = RightJacobian(w_board);
  const Eigen::Matrix3d J_camera = RightJacobian(-w_camera);
  using Row = Eigen::Matrix<double, kFitNumbers + 1, 1>;
  Eigen::Matrix<double, kFitNumbers + 1, kLight> mixed =
      Eigen::Matrix<double, kFitNumbers + 1, kLight>::Zero();
  normal.setZero();
  LensJacobian jacobian;
  Row full;
  for (const Sample& s : samples) {
    const Eigen::Matrix<double, 6, 1> basis = LightBasis(*s.pixel);
    const double white = basis.dot(light.head<6>());
    const double black = basis.dot(light.tail<6>());
    const Eigen::Vector3d X(s.place.x() * board_.square_m, s.place.y() * board_.square_m, 0);
    const Eigen::Vector3d p_first = T_first_board * X;
    const Eigen::Vector3d from_camera = p_first - T_first_camera.translation();
    ProjectWithLens(kind_, numbers.lens, R_camera_first * from_camera, jacobian);
    // The pattern's place under a pixel moves against its projection.
    const Eigen::RowVector2d by_pixel =
        -(white - black) * s.pattern.by_place.transpose() * s.squares_by_pixel;
    const Eigen::RowVector3d by_point = by_pixel * jacobian.by_point;
    full.head<kLensNumbers>() = (by_pixel * jacobian.by_lens).transpose();
    full.segment<3>(kLensNumbers) = (by_point * R_camera_first * Cross(from_camera) * J_camera).transpose();
    full.segment<3>(kLensNumbers + 3) = -(by_point * R_camera_first).transpose();
    full.segment<3>(kLensNumbers + 6) = (by_point * by_board_turn * Cross(X) * J_board).transpose();
    full.segment<3>(kLensNumbers + 9) = (by_point * R_camera_first).transpose();
    full(kFitNumbers) = (s.pattern.white * white + (1 - s.pattern.white) * black) - s.pixel->brightness;
    row << s.pattern.white * basis, (1 - s.pattern.white) * basis;
    const double weight = s.pixel->weight;
    normal.selfadjointView<Eigen::Lower>().rankUpdate(full, weight);
    mixed.noalias() += (weight * full) * row.transpose();
  }
  // The light gives way (Schur complement).
  normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
  normal -= mixed * light_solver.solve(mixed.transpose());
}

}  // namespace mixstage
