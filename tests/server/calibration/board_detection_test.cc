// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_detection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "server/calibration/board_order.h"
#include "tests/support/board_picture.h"

namespace mixstage {
namespace {

const Board kBoardA{"a", 9, 6, 0.07, 0.07};
const Board kBoardB{"b", 7, 5, 0.07, 0.07};

PinholeCamera Camera() {
  PinholeCamera c;
  c.width = 400;
  c.height = 300;
  c.fx = c.fy = 420;
  c.cx = 202;
  c.cy = 148;
  c.k1 = -0.1;
  c.k2 = 0.05;
  return c;
}

FisheyeCamera Fisheye() {
  FisheyeCamera c;
  c.width = c.height = 400;
  c.fx = c.fy = 116;
  c.cx = 202;
  c.cy = 197;
  c.k1 = 0.01;
  return c;
}

template <typename CameraModel>
double LargestError(const CameraModel& camera, const PlacedBoard& placed, const BoardSighting& s) {
  double largest = 0;
  for (std::size_t i = 0; i < s.corners.size(); ++i) {
    const auto p = camera.Project(placed.T_camera_board * placed.board.Corner(s.corners[i]));
    largest = std::max(largest, p ? (*p - s.pixels[i]).norm() : 1e9);
  }
  return largest;
}

TEST(BoardDetection, FindsTwoBoardsInOnePictureInTheirOwnOrder) {
  const PlacedBoard a{kBoardA, BoardAt(kBoardA, 1.9, 10, -25, 20, -0.25, 0)};
  const PlacedBoard b{kBoardB, BoardAt(kBoardB, 1.9, -15, 20, -10, 0.45, 0.05)};
  const cv::Mat1b picture = ToSrgb8(DrawBoards(Camera(), {a, b}, {}));
  const auto found = FindBoards(picture, {kBoardB, kBoardA}, 1);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].board, 1u);  // the larger first
  EXPECT_LT(LargestError(Camera(), a, found[0]), 0.5);
  EXPECT_LT(LargestError(Camera(), b, found[1]), 0.5);
  EXPECT_NEAR(found[0].rise_px, 2.563 * 0.6, 0.7);
}

TEST(BoardDetection, ABoardUpsideDownKeepsItsFirstCornerWhereColoursDecide) {
  const PlacedBoard a{kBoardA, BoardAt(kBoardA, 1.6, 5, 10, 175)};
  const auto found = FindBoards(ToSrgb8(DrawBoards(Camera(), {a}, {})), {kBoardA}, 1);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_LT(LargestError(Camera(), a, found[0]), 0.5);
}

TEST(BoardDetection, APartOfALargerBoardIsNoSmallerBoard) {
  const PlacedBoard a{kBoardA, BoardAt(kBoardA, 1.6, 5, 10, 5)};
  EXPECT_TRUE(FindBoards(ToSrgb8(DrawBoards(Camera(), {a}, {})), {kBoardB}, 1).empty());
}

TEST(BoardDetection, AnAmplitudePictureOf16BitsAndFewPixelsIsEnough) {
  PinholeCamera tof = Camera();
  tof.width = 176;
  tof.height = 144;
  tof.fx = tof.fy = 220;
  tof.cx = 90;
  tof.cy = 69;
  const PlacedBoard a{kBoardA, BoardAt(kBoardA, 2.2, 10, -20, 5)};
  BoardPictureLook look;
  look.spot_px = 0.4;
  cv::Mat1w amplitude;
  cv::Mat1f(DrawBoards(tof, {a}, look) * 3000).convertTo(amplitude, CV_16U);
  const auto found = FindBoards(ForDetection(amplitude), {kBoardA}, EnlargeFor(tof.width));
  ASSERT_EQ(found.size(), 1u);
  EXPECT_LT(LargestError(tof, a, found[0]), 0.5);
}

TEST(BoardDetection, AFisheyeSeesABoardBeyond75DegreesWithARoughGuess) {
  constexpr double kRad = std::numbers::pi / 180;
  PlacedBoard a{kBoardA, BoardAt(kBoardA, 0.75, 0, 10, 8)};
  RigidTransform aside = RigidTransform::Identity();
  aside.linear() = Eigen::AngleAxisd(68 * kRad, Eigen::Vector3d::UnitY()).toRotationMatrix();
  a.T_camera_board = aside * a.T_camera_board;
  FisheyeCamera guess = Fisheye();
  guess.fx = guess.fy = 120;
  guess.cx = guess.cy = 199.5;
  guess.k1 = 0;
  const auto found = FindBoardsInFisheye(ToSrgb8(DrawBoards(Fisheye(), {a}, {})), {kBoardA}, guess);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_LT(LargestError(Fisheye(), a, found[0]), 0.5);
}

TEST(BoardDetection, NoBoardNoSighting) {
  EXPECT_TRUE(FindBoards(ToSrgb8(DrawBoards(Camera(), {}, {})), {kBoardA}, 1).empty());
  EXPECT_TRUE(FindBoards(cv::Mat1b(5, 5, std::uint8_t{0}), {kBoardA}, 1).empty());
}

}  // namespace
}  // namespace mixstage
