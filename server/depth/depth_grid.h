// SPDX-License-Identifier: Apache-2.0
//
// The depth picture as a mesh: pictures of the depth camera's size with a border, so that kernels may look at
// neighbours and run over the end of a row without asking where the picture stops.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "proto/base/image_view.h"

namespace mixstage::depth {

struct GridShape {
  static constexpr int kBorder = 8;  // left and right of every row, one row above and below
  int width = 0, height = 0;
  [[nodiscard]] std::ptrdiff_t stride() const { return width + 2 * kBorder; }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(stride()) * static_cast<std::size_t>(height + 2);
  }
  [[nodiscard]] std::ptrdiff_t At(int x, int y) const { return (y + 1) * stride() + kBorder + x; }
};

// One value a pixel of the grid; the border is 0 (kernels write only zeros or nothing meaningful there).
template <typename T>
class GridPicture {
 public:
  GridPicture() = default;
  explicit GridPicture(const GridShape& shape) : shape_(shape), values_(shape.size(), T{}) {}
  [[nodiscard]] T* row(int y) { return values_.data() + shape_.At(0, y); }
  [[nodiscard]] const T* row(int y) const { return values_.data() + shape_.At(0, y); }
  // Element GridShape::At(x, y) is pixel (x, y).
  [[nodiscard]] const T* data() const { return values_.data(); }
  [[nodiscard]] ImageView<T> View() { return {row(0), shape_.width, shape_.height, shape_.stride()}; }

 private:
  GridShape shape_;
  std::vector<T> values_;
};

// What of a cell (the quad between pixels (x, y) and (x + 1, y + 1)) belongs to the surface. Its two
// triangles meet in the diagonal top right - bottom left: kUpper has the corner top left, kLower bottom
// right. kTurned: the other diagonal, a quarter turn clockwise, so that kUpper has the corner top right and
// kLower bottom left.
enum Cell : std::uint8_t {
  kUpper = 1,
  kLower = 2,
  kTurned = 4,
  kWhole = kUpper | kLower,
  kTorn = 8,  // part of it is missing although a corner was measured: nothing behind that corner can be
              // trusted here
};

}  // namespace mixstage::depth
