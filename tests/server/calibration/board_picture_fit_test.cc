// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_picture_fit.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <random>

#include "server/calibration/blurred_pattern.h"
#include "server/calibration/lens_jacobian.h"
#include "server/calibration/pixel_adjustment.h"
#include "tests/support/board_picture.h"

namespace mixstage {
namespace {

const Board kBoard{"a", 5, 4, 0.07, 0.07};

TEST(LensJacobian, IsTheNumericOneForBothModelsAlsoBeyond90Degrees) {
  Lens pinhole =
      LensOf(PinholeCamera{640, 480, 680, 690, 320, 240, -0.12, 0.06, 1e-3, -2e-3, 0.01, 0.02, 0.01, 0.005});
  Lens fisheye = LensOf(FisheyeCamera{480, 480, 140, 141, 242, 238, 0.012, -0.006, 0.0012, -0.0002});
  for (const auto& [lens, point] : {std::pair{pinhole, Eigen::Vector3d(0.4, -0.3, 1.5)},
                                    std::pair{fisheye, Eigen::Vector3d(0.4, -0.3, 0.5)},
                                    std::pair{fisheye, Eigen::Vector3d(0.9, 0.5, -0.1)}}) {
    LensJacobian j;
    ProjectWithLens(lens.kind, lens.numbers.data(), point, j);
    auto pixel = [&, lens = lens](const std::array<double, kLensNumbers>& n, const Eigen::Vector3d& p) {
      Eigen::Vector2d out;
      ProjectThrough(lens.kind, n.data(), p.data(), out.data());
      return out;
    };
    EXPECT_LT((j.pixel - pixel(lens.numbers, point)).norm(), 1e-9);
    constexpr double kStep = 1e-6;
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(i);
      const Eigen::Vector2d numeric =
          (pixel(lens.numbers, point + d) - pixel(lens.numbers, point - d)) / (2 * kStep);
      EXPECT_LT((numeric - j.by_point.col(i)).norm(), 1e-4) << i;
    }
    for (int i : lens.kind == LensKind::kPinhole ? std::vector<int>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}
                                                 : lens.free) {
      auto above = lens.numbers;
      auto below = lens.numbers;
      above[static_cast<std::size_t>(i)] += kStep;
      below[static_cast<std::size_t>(i)] -= kStep;
      const Eigen::Vector2d numeric = (pixel(above, point) - pixel(below, point)) / (2 * kStep);
      EXPECT_LT((numeric - j.by_lens.col(i)).norm(), 1e-4) << i;
    }
  }
}

TEST(BlurredPattern, IsTheMeanOverASlantingSpotAndItsDerivativesAreNumeric) {
  Eigen::Matrix2d squares_by_pixel;
  squares_by_pixel << 0.11, 0.03, -0.02, 0.09;
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal(0, 1);
  for (const Eigen::Vector2d& place :
       {Eigen::Vector2d(1.03, 2.02), Eigen::Vector2d(2.95, 1.5), Eigen::Vector2d(0.05, -0.04)}) {
    const PatternValue value = BlurredPattern(kBoard, place, squares_by_pixel, 0.8);
    ASSERT_TRUE(value.known);
    double white = 0;
    constexpr int kRays = 200000;
    for (int i = 0; i < kRays; ++i) {
      const Eigen::Vector2d p =
          place + squares_by_pixel * (0.8 * Eigen::Vector2d(normal(random), normal(random)));
      white += (static_cast<int>(std::floor(p.x()) + std::floor(p.y()) + 100) % 2 == 0 ? 0.0 : 1.0) / kRays;
    }
    EXPECT_NEAR(value.white, white, 0.005);
    constexpr double kStep = 1e-5;
    for (int i = 0; i < 2; ++i) {
      const Eigen::Vector2d d = kStep * Eigen::Vector2d::Unit(i);
      EXPECT_NEAR(value.by_place(i),
                  (BlurredPattern(kBoard, place + d, squares_by_pixel, 0.8).white -
                   BlurredPattern(kBoard, place - d, squares_by_pixel, 0.8).white) /
                      (2 * kStep),
                  2e-3);
    }
    EXPECT_NEAR(value.by_spot,
                (BlurredPattern(kBoard, place, squares_by_pixel, 0.8 + kStep).white -
                 BlurredPattern(kBoard, place, squares_by_pixel, 0.8 - kStep).white) /
                    (2 * kStep),
                2e-3);
  }
}

// Eight pictures of a board through a small camera, known truth.
struct Rendered {
  BoardScene truth;
  std::vector<cv::Mat1f> pictures;
};

Rendered Render(double noise, std::uint64_t seed) {
  Rendered r;
  PinholeCamera camera{160, 120, 171, 171, 81, 58.5, -0.1, 0.04};
  r.truth.boards = {kBoard};
  r.truth.cameras.push_back({"color", LensOf(camera), RigidTransform::Identity(), 0.1});
  int i = 0;
  for (const auto& [z, x_deg, y_deg, right, down] : {std::tuple{0.6, 30.0, 10.0, -0.06, -0.03},
                                                     {0.65, -30.0, 5.0, 0.08, -0.05},
                                                     {0.7, 10.0, 35.0, -0.1, 0.06},
                                                     {0.65, 5.0, -35.0, 0.07, 0.07},
                                                     {0.9, 25.0, -25.0, 0.2, -0.12},
                                                     {0.9, -25.0, 25.0, -0.2, 0.12}}) {
    const RigidTransform T = BoardAt(kBoard, z, x_deg, y_deg, 7.0 * i, right, down);
    r.truth.placements.push_back({"view " + std::to_string(i), static_cast<std::size_t>(i), 0, T, false});
    BoardPictureLook look;
    look.noise = noise;
    look.slope = 0.3;
    look.spot_px = 0.55;
    look.seed = seed + static_cast<std::uint64_t>(i);
    r.pictures.push_back(DrawBoards(camera, {{kBoard, T}}, look));
    BoardSighting s;
    for (int k = 0; k < kBoard.corners(); ++k) {
      s.corners.push_back(k);
      s.pixels.push_back(*r.truth.cameras[0].lens.Project(T * kBoard.Corner(k)));
    }
    r.truth.sightings.push_back({0, static_cast<std::size_t>(i), s, "", "", 0});
    ++i;
  }
  return r;
}

double MeanProjectionDifference(const BoardScene& a, const BoardScene& b) {
  double sum = 0;
  int n = 0;
  for (std::size_t p = 0; p < a.placements.size(); ++p) {
    for (int k = 0; k < kBoard.corners(); ++k) {
      const auto pa = a.cameras[0].lens.Project(a.TCameraBoard(0, p) * kBoard.Corner(k));
      const auto pb = b.cameras[0].lens.Project(b.TCameraBoard(0, p) * kBoard.Corner(k));
      sum += pa && pb ? (*pa - *pb).norm() : 1e6;
      ++n;
    }
  }
  return sum / n;
}

BoardScene Perturbed(const BoardScene& truth) {
  BoardScene scene = truth;
  scene.cameras[0].lens.numbers[0] += 0.6;
  scene.cameras[0].lens.numbers[2] -= 0.4;
  scene.cameras[0].lens.numbers[4] += 0.01;
  for (Placement& p : scene.placements) p.T_first_board->translation() += Eigen::Vector3d(4e-4, -3e-4, 1e-3);
  return scene;
}

TEST(PixelAdjustment, BeatsWhatCornersOfATenthOfAPixelCanGive) {
  const Rendered r = Render(0.01, 1);
  BoardScene scene = Perturbed(r.truth);
  EXPECT_GT(MeanProjectionDifference(scene, r.truth), 0.1);
  for (int round = 0; round < 2; ++round) {
    const auto pictures = FitPictures(scene, [&](std::size_t, std::size_t view) { return r.pictures[view]; });
    ASSERT_EQ(pictures.size(), r.pictures.size());
    EXPECT_NEAR(pictures[0].fit.spot_px(), 0.55, 0.08);
    ASSERT_TRUE(AdjustToPixels(pictures, scene, 15));
  }
  EXPECT_LT(MeanProjectionDifference(scene, r.truth), 0.015);
}

// Deviations against the spread of what many noisy pictures give. spread_px: how far noise reaches over
// neighbouring pixels.
void ExpectHonestDeviations(float noise_sigma, double spread_px) {
  constexpr int kRuns = 12;
  std::array<double, 4> sums{};
  std::array<double, 4> squares{};
  std::array<double, 4> predicted{};
  const Rendered clean = Render(0, 1);
  std::mt19937_64 random(5);
  std::normal_distribution<float> noise(0, noise_sigma);
  for (int run = 0; run < kRuns; ++run) {
    Rendered r = clean;
    for (cv::Mat1f& picture : r.pictures) {
      cv::Mat1f field(picture.size());
      for (float& value : field) value = noise(random);
      if (spread_px > 0) cv::GaussianBlur(field, field, {}, spread_px);
      picture = picture.clone();
      picture += field;
    }
    BoardScene scene = r.truth;
    const auto pictures = FitPictures(scene, [&](std::size_t, std::size_t view) { return r.pictures[view]; });
    ASSERT_TRUE(AdjustToPixels(pictures, scene, 15));
    const auto deviations = DeviationsByPixels(pictures, scene);
    ASSERT_TRUE(deviations) << deviations.error().message;
    for (std::size_t i = 0; i < 4; ++i) {
      const double error = scene.cameras[0].lens.numbers[i] - r.truth.cameras[0].lens.numbers[i];
      sums[i] += error;
      squares[i] += error * error;
      predicted[i] += (*deviations)[0]->lens[i] / kRuns;
    }
  }
  // 12 runs know a sigma to 20 %, six boards what they contradict each other by to 40 %.
  for (std::size_t i = 0; i < 4; ++i) {
    const double spread = std::sqrt((squares[i] - sums[i] * sums[i] / kRuns) / (kRuns - 1));
    EXPECT_GT(spread, 0.5 * predicted[i]) << i;
    EXPECT_LT(spread, 1.8 * predicted[i]) << i;
    EXPECT_LT(std::abs(sums[i] / kRuns), 1.2 * predicted[i]) << i;
  }
}

TEST(PixelAdjustment, ItsDeviationsAreThoseThatRepeatedPicturesShow) { ExpectHonestDeviations(0.03f, 0); }

TEST(PixelAdjustment, NoiseThatReachesOverManyPixelsWidensItsDeviations) {
  ExpectHonestDeviations(0.12f, 1.2);
}

TEST(BoardPictureFit, APictureWithoutTheBoardIsRefused) {
  const Rendered r = Render(0.01, 1);
  cv::Mat1f empty(r.pictures[0].size(), 0.4f);
  EXPECT_FALSE(BoardPictureFit::Prepare(empty, r.truth.cameras[0].lens, kBoard, RigidTransform::Identity(),
                                        *r.truth.placements[0].T_first_board));
  EXPECT_FALSE(BoardPictureFit::Prepare(r.pictures[1], r.truth.cameras[0].lens, kBoard,
                                        RigidTransform::Identity(), *r.truth.placements[0].T_first_board));
}

}  // namespace
}  // namespace mixstage
