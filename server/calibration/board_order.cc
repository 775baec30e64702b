// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_order.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace mixstage {
namespace {

using Eigen::Vector2d;

class Grid {
 public:
  Grid(const Board& board, const std::vector<Vector2d>& pixels) : board_(board), pixels_(pixels) {}

  // Corner (column, row), continued linearly up to two squares beyond the outer ones.
  [[nodiscard]] Vector2d At(int column, int row) const {
    const int c = std::clamp(column, 0, board_.columns - 1);
    const int r = std::clamp(row, 0, board_.rows - 1);
    const int dc = column - c;
    const int dr = row - r;
    Vector2d p = Inside(c, r);
    if (dc != 0) p += std::abs(dc) * (Inside(c, r) - Inside(dc > 0 ? c - 1 : c + 1, r));
    if (dr != 0) p += std::abs(dr) * (Inside(c, r) - Inside(c, dr > 0 ? r - 1 : r + 1));
    return p;
  }

  // Centre of the square whose first corner is (column, row), and its colour: the mean of 3 x 3 samples.
  [[nodiscard]] std::optional<double> Brightness(const cv::Mat1b& picture, int column, int row) const {
    const Vector2d a = At(column, row);
    const Vector2d b = At(column + 1, row);
    const Vector2d c = At(column, row + 1);
    const Vector2d d = At(column + 1, row + 1);
    double sum = 0;
    for (double s : {0.35, 0.5, 0.65}) {
      for (double t : {0.35, 0.5, 0.65}) {
        const Vector2d p = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
        const auto u = static_cast<int>(std::lround(p.x()));
        const auto v = static_cast<int>(std::lround(p.y()));
        if (u < 0 || v < 0 || u >= picture.cols || v >= picture.rows) return std::nullopt;
        sum += picture(v, u);
      }
    }
    return sum / 9;
  }

 private:
  [[nodiscard]] const Vector2d& Inside(int column, int row) const {
    return pixels_[static_cast<std::size_t>(row * board_.columns + column)];
  }
  const Board& board_;
  const std::vector<Vector2d>& pixels_;
};

double Cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

// All squares turn the same way round: +1 or -1; 0 where the grid folds.
int Handedness(const Board& board, const Grid& grid) {
  int turn = 0;
  for (int r = 0; r + 1 < board.rows; ++r) {
    for (int c = 0; c + 1 < board.columns; ++c) {
      const Vector2d p = grid.At(c, r);
      const double area = Cross(grid.At(c + 1, r) - p, grid.At(c, r + 1) - p);
      const double other =
          Cross(grid.At(c, r + 1) - grid.At(c + 1, r + 1), grid.At(c + 1, r) - grid.At(c + 1, r + 1));
      const int here = area > 0 && other > 0 ? 1 : area < 0 && other < 0 ? -1 : 0;
      if (here == 0 || (turn != 0 && here != turn)) return 0;
      turn = here;
    }
  }
  return turn;
}

// +1: squares with an even sum of column and row are the black ones, -1: the white ones, 0: no checkerboard.
int EvenSquaresAreBlack(const cv::Mat1b& picture, const Board& board, const Grid& grid) {
  int even_black = 0;
  int even_white = 0;
  for (int r = 0; r + 1 < board.rows; ++r) {
    for (int c = 0; c + 1 < board.columns; ++c) {
      for (const auto& [dc, dr] : {std::pair{1, 0}, std::pair{0, 1}}) {
        if (c + dc + 1 >= board.columns || r + dr + 1 >= board.rows) continue;
        const auto here = grid.Brightness(picture, c, r);
        const auto there = grid.Brightness(picture, c + dc, r + dr);
        if (!here || !there) continue;
        const bool even = (c + r) % 2 == 0;
        if ((*here < *there) == even) {
          ++even_black;
        } else {
          ++even_white;
        }
      }
    }
  }
  const int all = even_black + even_white;
  if (all < 4) return 0;
  if (even_black > 0.9 * all) return 1;
  if (even_white > 0.9 * all) return -1;
  return 0;
}

// A larger board's part: two squares beyond an outer corner's line the colours still alternate like inside.
bool PatternGoesOn(const cv::Mat1b& picture, const Board& board, const Grid& grid, int even_black) {
  auto side_goes_on = [&](auto square, int count) {
    double even = 0;
    double odd = 0;
    int n = 0;
    double inside = 0;
    int alike = 0;
    for (int i = 0; i + 1 < count; i += 1) {
      const auto [outer_c, outer_r, inner_c, inner_r] = square(i);
      const auto outer = grid.Brightness(picture, outer_c, outer_r);
      const auto inner = grid.Brightness(picture, inner_c, inner_r);
      if (!outer || !inner) continue;
      const double sign = ((outer_c + outer_r) % 2 == 0) == (even_black > 0) ? -1 : 1;
      (sign < 0 ? even : odd) += *outer;
      inside += sign * *inner * (((inner_c + inner_r) - (outer_c + outer_r)) % 2 == 0 ? 1 : -1);
      // Nearer to the colour it would have than to its neighbour's?
      const auto next = grid.Brightness(picture, inner_c + (inner_c == outer_c ? (i == 0 ? 1 : -1) : 0),
                                        inner_r + (inner_r == outer_r ? (i == 0 ? 1 : -1) : 0));
      alike += next && std::abs(*outer - *inner) < std::abs(*outer - *next);
      ++n;
    }
    if (n < 3 || alike < 0.8 * n) return false;  // what stands beside a board alternates by chance only
    return (odd - even) > 0.5 * inside && inside > 0;
  };
  const int c = board.columns;
  const int r = board.rows;
  return side_goes_on(
             [&](int i) {
               return std::array{i, -2, i, 0};
             },
             c) ||
         side_goes_on(
             [&](int i) {
               return std::array{i, r, i, r - 2};
             },
             c) ||
         side_goes_on(
             [&](int i) {
               return std::array{-2, i, 0, i};
             },
             r) ||
         side_goes_on(
             [&](int i) {
               return std::array{c, i, c - 2, i};
             },
             r);
}

}  // namespace

void TurnUpsideDown(std::vector<Vector2d>& pixels) { std::reverse(pixels.begin(), pixels.end()); }

bool PutInBoardOrder(const cv::Mat1b& picture, const Board& board, std::vector<Vector2d>& pixels) {
  const Grid grid(board, pixels);  // follows what is done to pixels
  int turn = Handedness(board, grid);
  if (turn == 0) return false;
  if (turn < 0) {  // counted as in a mirror: the rows from the other end
    for (int r = 0; r < board.rows / 2; ++r) {
      std::swap_ranges(pixels.begin() + r * board.columns, pixels.begin() + (r + 1) * board.columns,
                       pixels.begin() + (board.rows - 1 - r) * board.columns);
    }
  }
  int even_black = EvenSquaresAreBlack(picture, board, grid);
  if (even_black == 0) return false;
  if (PatternGoesOn(picture, board, grid, even_black)) return false;
  if (board.LooksTheSameUpsideDown()) {
    const auto last_row = pixels.end() - board.columns;
    double down = 0;
    for (int c = 0; c < board.columns; ++c) down += (last_row + c)->y() - (pixels.begin() + c)->y();
    if (down < 0) TurnUpsideDown(pixels);
  } else if (even_black < 0) {
    TurnUpsideDown(pixels);
  }
  return true;
}

}  // namespace mixstage
