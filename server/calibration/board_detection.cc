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

// In windows well inside the squares.
std::vector<Vector2d> ByGradient(const cv::Mat1b& picture, const std::vector<Vector2d>& pixels,
                                 double square_px) {
  std::vector<cv::Point2f> points;
  for (const Vector2d& p : pixels) points.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  const int half = std::clamp(cvRound(0.2 * square_px), 2, 6);
  cv::cornerSubPix(picture, points, cv::Size(half, half), cv::Size(-1, -1),
                   cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4));
  std::vector<Vector2d> found;
  for (const cv::Point2f& p : points) found.emplace_back(p.x, p.y);
  return found;
}

enum class Search {
  kSaddles = 1,  // exhaustive
  kOtherwise,  // what it misses: the plain search for saddles, and by contours, which strong lenses bend less
};

// Grid of a whole board in its own order; empty where there is none.
std::vector<Vector2d> FindGrid(const cv::Mat1b& picture, const Board& board, Search search) {
  const cv::Size size(board.columns, board.rows);
  std::vector<cv::Point2f> found;
  bool by_contours = false;
  try {
    if (search == Search::kSaddles) {
      if (!cv::findChessboardCornersSB(picture, size, found, cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY))
        return {};
    } else if (!cv::findChessboardCornersSB(picture, size, found, cv::CALIB_CB_ACCURACY)) {
      by_contours = cv::findChessboardCorners(
          picture, size, found,
          cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_FAST_CHECK);
      if (!by_contours) return {};
    }
  } catch (const cv::Exception&) {
    return {};  // it throws on some pictures that are too small for the board
  }
  if (static_cast<int>(found.size()) != board.corners()) return {};
  std::vector<Vector2d> pixels;
  for (const cv::Point2f& p : found) pixels.emplace_back(p.x, p.y);
  if (by_contours) pixels = ByGradient(picture, pixels, SquareSide(board, pixels));
  if (!PutInBoardOrder(picture, board, pixels)) return {};
  return pixels;
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
  s.gradient_pixels = ByGradient(picture, pixels, s.square_px);
  s.pixels = std::move(pixels);
  return s;
}

std::vector<BoardSighting> FindBoardsBy(Search search, const cv::Mat1b& picture,
                                        const std::vector<Board>& boards, int enlarge) {
  cv::Mat1b enlarged;
  cv::resize(picture, enlarged, cv::Size(), enlarge, enlarge,
             enlarge > 1 ? cv::INTER_CUBIC : cv::INTER_NEAREST);
  std::vector<BoardSighting> found;
  for (std::size_t i : BySize(boards)) {
    std::vector<Vector2d> pixels = FindGrid(enlarged, boards[i], search);
    if (pixels.empty()) continue;
    CoverUp(enlarged, boards[i], pixels);
    for (Vector2d& p : pixels) p = (p.array() + 0.5) / enlarge - 0.5;
    found.push_back(Sighting(i, boards[i], picture, std::move(pixels)));
  }
  return found;
}

}  // namespace

int EnlargeFor(int width_px) { return width_px <= 240 ? 3 : width_px <= 512 ? 2 : 1; }

cv::Mat1b ForDetection(const cv::Mat& picture) {
  cv::Mat grey = picture;
  if (picture.channels() == 3) cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  cv::Mat1f values;
  grey.convertTo(values, CV_32F);
  std::vector<float> sorted(values.begin(), values.end());
  const auto at =
      sorted.begin() + static_cast<std::ptrdiff_t>(0.997 * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), at, sorted.end());
  const float bright = std::max(*at, 1.0f);
  if (grey.depth() == CV_8U) {
    constexpr float kDark = 128;  // an infrared picture as many cameras hand it out
    if (bright >= kDark) return grey;
    cv::Mat1b stretched;
    grey.convertTo(stretched, CV_8U, 255 / bright);
    return stretched;
  }
  cv::Mat1b out(values.size());
  std::transform(values.begin(), values.end(), out.begin(), [bright](float v) {
    return cv::saturate_cast<std::uint8_t>(255.0f * std::sqrt(std::max(v, 0.0f) / bright));
  });
  return out;
}

std::vector<BoardSighting> FindBoards(const cv::Mat1b& picture, const std::vector<Board>& boards,
                                      int enlarge) {
  auto found = FindBoardsBy(Search::kSaddles, picture, boards, enlarge);
  return found.empty() ? FindBoardsBy(Search::kOtherwise, picture, boards, enlarge) : found;
}

std::vector<BoardSighting> FindBoardsInFisheye(const cv::Mat1b& picture, const std::vector<Board>& boards,
                                               const FisheyeCamera& camera) {
  std::vector<BoardSighting> found = FindBoardsBy(Search::kSaddles, picture, boards, 1);
  auto missing = [&](std::size_t i) {
    return std::none_of(found.begin(), found.end(), [&](const BoardSighting& s) { return s.board == i; });
  };
  cv::Mat1b rest = picture.clone();
  for (const BoardSighting& s : found) CoverUp(rest, boards[s.board], s.pixels);
  for (std::size_t i : BySize(boards)) {
    if (!missing(i)) continue;
    for (const FisheyeView& view : ViewsAround(camera)) {
      std::vector<Vector2d> pixels = FindGrid(DrawView(rest, camera, view), boards[i], Search::kSaddles);
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
  return found.empty() ? FindBoardsBy(Search::kOtherwise, picture, boards, 1) : found;
}

}  // namespace mixstage
