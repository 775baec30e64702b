// SPDX-License-Identifier: Apache-2.0
//
// Checkerboards as board.json states them. Frame of a board: origin at its first
// inner corner, x along its columns, y along its rows (down when it hangs upright), z into the board; metres.
// Corners are counted row by row: corner i lies at (i % columns, i / columns) squares.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "proto/base/result.h"

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
  // A half turn shows the same picture: squares of equal colour lie at opposite ends (both counts odd or both
  // even). Other boards have their first corner at the end whose outermost squares are black.
  [[nodiscard]] bool LooksTheSameUpsideDown() const { return (columns + rows) % 2 == 0; }
};

// One board or a list of them. Fails (kBadInput, the field named) on another pattern than "checkerboard",
// counts outside 3..100, sizes that are not finite and positive, and two boards with the same counts (they
// could not be told apart).
Result<std::vector<Board>> ParseBoards(const std::string& json_text);
Result<std::vector<Board>> LoadBoards(const std::filesystem::path& file);

}  // namespace mixstage
