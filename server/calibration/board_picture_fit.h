// SPDX-License-Identifier: Apache-2.0
//
// One board in one picture, synthesised and compared pixel by pixel (MixIn3D 2.1, analysis-by-synthesis):
// black and white squares through the camera's model and a Gaussian spot; white and black each vary
// quadratically over the picture (light, vignetting, distance).
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "server/calibration/board_scene.h"

namespace mixstage {

// Where an adjustment's numbers stand: lens, T_first_camera, T_first_board.
struct FitNumbers {
  const double* lens = nullptr;          // [kLensNumbers]
  const double* first_camera = nullptr;  // [6]
  const double* first_board = nullptr;   // [6]
};

inline constexpr int kFitNumbers = kLensNumbers + 12;
// (J r)^T (J r) over all pixels, light marginalised; the last row and column are the residual's.
using FitNormal = Eigen::Matrix<double, kFitNumbers + 1, kFitNumbers + 1>;

class BoardPictureFit {
 public:
  // `brightness` [h x w], proportional to light. Takes the pixels near edges between squares, inside the
  // board's outer squares; estimates spot, light, noise and which pixels do not belong (hands, highlights).
  // Nothing where fewer than 200 pixels show edges or the picture does not look like the board there.
  static std::optional<BoardPictureFit> Prepare(const cv::Mat1f& brightness, const Lens& lens,
                                                const Board& board, const RigidTransform& T_first_camera,
                                                const RigidTransform& T_first_board);

  // The normal equations at the numbers given; residuals are over sigma.
  void Accumulate(const FitNumbers& numbers, FitNormal& normal) const;

  [[nodiscard]] double spot_px() const { return spot_px_; }
  [[nodiscard]] std::size_t pixels() const { return pixels_.size(); }
  // Residual over contrast, rms, at Prepare.
  [[nodiscard]] double misfit() const { return misfit_; }

 private:
  struct Pixel {
    float u, v, brightness;
    float weight;           // robust, over variance
    Eigen::Vector2f place;  // on the board, squares: where Newton's method starts
  };
  BoardPictureFit(LensKind kind, const Board& board) : kind_(kind), board_(board) {}

  void Select(const cv::Mat1f& brightness, const Lens& lens, const RigidTransform& T_camera_board);
  // One round of light, spot, noise and weights. False where the picture does not show the board.
  bool Weigh(const FitNumbers& numbers);
  // Calls each(pixel, pattern, pixel-to-place matrix, place) where the pixel's place is found.
  template <typename Each>
  void ForEach(const FitNumbers& numbers, Each each) const;
  [[nodiscard]] Eigen::Matrix<double, 6, 1> LightBasis(const Pixel& p) const;

  LensKind kind_;
  Board board_;
  std::vector<Pixel> pixels_;
  Eigen::Vector2d middle_ = Eigen::Vector2d::Zero();  // of the pixels, and half their extent
  double extent_ = 1;
  double spot_px_ = 0.7;
  double misfit_ = 0;
};

}  // namespace mixstage
