// SPDX-License-Identifier: Apache-2.0
//
// Boards in pictures. algorithms: cv::findChessboardCornersSB (Duda and Frese 2018: sub-pixel saddle points),
// on a ToF camera's amplitude after enlarging and evening it out, in a fisheye picture also on perspective
// views off its axis. What is found is checked square by square and counted in the board's own order
// (board.h): never mirrored; where the colours decide not upside down, else with its rows running down.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/board.h"
#include "proto/geometry/camera_model.h"

namespace mixstage {

struct BoardSighting {
  std::size_t board = 0;                // of the list searched for
  std::vector<int> corners;             // which of the board's, rising; a whole board or part of one
  std::vector<Eigen::Vector2d> pixels;  // where, same order
  // The same by the gradient about each (cv::cornerSubPix): noisier, but less biased where a camera sharpens
  // or its edges are soft. StartLens says which of the two a camera's lens fits.
  std::vector<Eigen::Vector2d> gradient_pixels;
  double sigma_px = 0.1;  // of a coordinate, expected; the joint adjustment estimates it per camera
  double square_px = 0;   // side of a square, mean
  double rise_px = 0;     // width of the edges from 10 to 90 %, mean; 0 = not measured
};

// 8-bit grey of any picture (8- or 16-bit, grey or BGR) in which a board's squares stand apart: 16-bit
// pictures (amplitude, infrared) by the root of their values over the 99.7th percentile, dark 8-bit ones by
// their values over it.
[[nodiscard]] cv::Mat1b ForDetection(const cv::Mat& picture);

// Whole boards, each at most once, larger ones first. `enlarge` (1..4): the search runs on the picture that
// many times larger; boards whose squares are below some 8 px need it. Any thread.
[[nodiscard]] std::vector<BoardSighting> FindBoards(const cv::Mat1b& picture,
                                                    const std::vector<Board>& boards, int enlarge);

// The same through a fisheye: `camera` is a guess good to some 10 %; corners are those of `picture` itself.
[[nodiscard]] std::vector<BoardSighting> FindBoardsInFisheye(const cv::Mat1b& picture,
                                                             const std::vector<Board>& boards,
                                                             const FisheyeCamera& camera);

// Enlarging that a picture of this width is searched with.
[[nodiscard]] int EnlargeFor(int width_px);

}  // namespace mixstage
