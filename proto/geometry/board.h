// SPDX-License-Identifier: Apache-2.0
//
// A checkerboard. Its frame: origin at its first inner corner, x along its columns, y along its rows (down
// when it hangs upright), z into the board (away from who looks at its front); metres. Corners are counted
// row by row: corner i lies at (i % columns, i / columns) squares.
#pragma once

#include <Eigen/Core>
#include <string>

namespace mixstage {

struct Board {
  std::string name;
  int columns = 0, rows = 0;  // inner corners along x and y
  double square_m = 0;
  double white_margin_m = 0;  // white around the outer squares; 0 = not known

  [[nodiscard]] int corners() const { return columns * rows; }
  [[nodiscard]] Eigen::Vector3d Corner(int i) const {
    return {square_m * (i % columns), square_m * (i / columns), 0};
  }
  // The paper's edges: least and largest x and y.
  [[nodiscard]] Eigen::Vector2d Low() const { return Eigen::Vector2d::Constant(-square_m - white_margin_m); }
  [[nodiscard]] Eigen::Vector2d High() const {
    return Eigen::Vector2d(columns * square_m, rows * square_m) + Eigen::Vector2d::Constant(white_margin_m);
  }
  // A half turn shows the same picture: squares of equal colour lie at opposite ends (both counts odd or both
  // even). Other boards have their first corner at the end whose outermost squares are black.
  [[nodiscard]] bool LooksTheSameUpsideDown() const { return (columns + rows) % 2 == 0; }
};

}  // namespace mixstage
