// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_detection.h"

#include <algorithm>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "server/calibration/board_order.h"
#include "server/calibration/edge_rise.h"
#include "server/calibration/fisheye_views.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;

// Larger boards first: a smaller one may be a part of theirs.
std::vector<std::size_t> BySize(const std::vector<Board>& boards) {
  std::vector<std::size_t> order(boards.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return boards[a].corners() > boards[b].corners(); });
  return order;
}

// Grid of a whole board in its own order; empty where there is none.
std::vector<Vector2d> FindGrid(const cv::Mat1b& picture, const Board& board) {
  std::vector<cv::Point2f> found;
  try {
    if (!cv::findChessboardCornersSB(picture, cv::Size(board.columns, board.rows), found,
                                     cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY)) {
      return {};
    }
  } catch (const cv::Exception&) {
    return {};  // it throws on some pictures that are too small for the board
  }
  if (static_cast<int>(found.size()) != board.corners()) return {};
  std::vector<Vector2d> pixels;
  for (const cv::Point2f& p : found) pixels.emplace_back(p.x, p.y);
  if (!PutInBoardOrder(picture, board, pixels)) return {};
  return pixels;
}

double SquareSide(const Board& board, const std::vector<Vector2d>& pixels) {
  double sum = 0;
  for (int r = 0; r < board.rows; ++r) {
    for (int c = 0; c + 1 < board.columns; ++c) {
      const auto i = static_cast<std::size_t>(r * board.columns + c);
      sum += (pixels[i + 1] - pixels[i]).norm();
    }
  }
  return sum / (board.rows * (board.columns - 1));
}

// Paints a found board over, so that the search does not come back to it.
void CoverUp(cv::Mat1b& picture, const Board& board, const std::vector<Vector2d>& pixels) {
  auto at = [&](int i) { return pixels[static_cast<std::size_t>(i)]; };
  const int last = board.corners() - 1;
  const Vector2d centre = 0.25 * (at(0) + at(board.columns - 1) + at(last) + at(last - board.columns + 1));
  const double grow = 1.0 + 2.2 / (std::min(board.columns, board.rows) - 1);
  std::vector<cv::Point> outline;
  for (int i : {0, board.columns - 1, last, last - board.columns + 1}) {
    const Vector2d p = centre + grow * (at(i) - centre);
    outline.emplace_back(cvRound(p.x()), cvRound(p.y()));
  }
  cv::fillConvexPoly(picture, outline, cv::Scalar(cv::mean(picture)[0]));
}

BoardSighting Sighting(std::size_t index, const Board& board, const cv::Mat1b& picture,
                       std::vector<Vector2d> pixels) {
  BoardSighting s;
  s.board = index;
  s.corners.resize(pixels.size());
  std::iota(s.corners.begin(), s.corners.end(), 0);
  s.square_px = SquareSide(board, pixels);
  s.rise_px = EdgeRise(picture, board, pixels);
  s.pixels = std::move(pixels);
  return s;
}

}  // namespace

int EnlargeFor(int width_px) { return width_px <= 240 ? 3 : width_px <= 512 ? 2 : 1; }

cv::Mat1b ForDetection(const cv::Mat& picture) {
  cv::Mat grey = picture;
  if (picture.channels() == 3) cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  if (grey.depth() == CV_8U) return grey;
  cv::Mat1f values;
  grey.convertTo(values, CV_32F);
  std::vector<float> sorted(values.begin(), values.end());
  const auto at =
      sorted.begin() + static_cast<std::ptrdiff_t>(0.997 * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), at, sorted.end());
  const float bright = std::max(*at, 1.0f);
  cv::Mat1b out(values.size());
  std::transform(values.begin(), values.end(), out.begin(), [bright](float v) {
    return cv::saturate_cast<std::uint8_t>(255.0f * std::sqrt(std::max(v, 0.0f) / bright));
  });
  return out;
}

std::vector<BoardSighting> FindBoards(const cv::Mat1b& picture, const std::vector<Board>& boards,
                                      int enlarge) {
  cv::Mat1b search;
  cv::resize(picture, search, cv::Size(), enlarge, enlarge,
             enlarge > 1 ? cv::INTER_CUBIC : cv::INTER_NEAREST);
  std::vector<BoardSighting> found;
  for (std::size_t i : BySize(boards)) {
    std::vector<Vector2d> pixels = FindGrid(search, boards[i]);
    if (pixels.empty()) continue;
    CoverUp(search, boards[i], pixels);
    for (Vector2d& p : pixels) p = (p.array() + 0.5) / enlarge - 0.5;
    found.push_back(Sighting(i, boards[i], picture, std::move(pixels)));
  }
  return found;
}

std::vector<BoardSighting> FindBoardsInFisheye(const cv::Mat1b& picture, const std::vector<Board>& boards,
                                               const FisheyeCamera& camera) {
  std::vector<BoardSighting> found = FindBoards(picture, boards, 1);
  auto missing = [&](std::size_t i) {
    return std::none_of(found.begin(), found.end(), [&](const BoardSighting& s) { return s.board == i; });
  };
  cv::Mat1b rest = picture.clone();
  for (const BoardSighting& s : found) CoverUp(rest, boards[s.board], s.pixels);
  for (std::size_t i : BySize(boards)) {
    if (!missing(i)) continue;
    for (const FisheyeView& view : ViewsAround(camera)) {
      std::vector<Vector2d> pixels = FindGrid(DrawView(rest, camera, view), boards[i]);
      if (pixels.empty()) continue;
      const bool inside = std::all_of(pixels.begin(), pixels.end(), [&](Vector2d& p) {
        const auto q = ToFisheye(camera, view, p);
        if (q) p = *q;
        return q.has_value();
      });
      if (!inside) continue;
      CoverUp(rest, boards[i], pixels);
      found.push_back(Sighting(i, boards[i], picture, std::move(pixels)));
      break;
    }
  }
  return found;
}

}  // namespace mixstage
