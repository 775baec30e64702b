// SPDX-License-Identifier: Apache-2.0
//
// Rounded mean over a square of bytes, the picture's border repeated: cv::blur's result, but whole vectors at
// a time in both directions.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace mixstage {

class BoxMean {
 public:
  // Squares of 2 reach + 1; reach 1 to 7 (checked).
  explicit BoxMean(int reach);
  // from, to [h x w]; not the same picture. Allocates on a new width only.
  void Run(const cv::Mat1b& from, cv::Mat1b* to);

 private:
  int reach_;
  std::vector<std::uint8_t> padded_;     // a row, its ends repeated
  std::vector<std::uint16_t> row_sums_;  // of the square's rows, in turn
  std::vector<std::uint16_t> sums_;      // of the square
};

// The same of a 3x3 square of floats, in place.
void MeanOf3x3(cv::Mat1f* plane);

}  // namespace mixstage
