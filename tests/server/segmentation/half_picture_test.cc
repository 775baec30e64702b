// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/half_picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace mixstage {
namespace {

YuvImage Random(int width, int height, ChromaLayout layout) {
  YuvImage image;
  image.Create(width, height, layout);
  std::mt19937 random(3);
  for (cv::Mat1b* plane : {&image.y, &image.cb, &image.cr}) {
    for (int y = 0; y < plane->rows; ++y) {
      for (int x = 0; x < plane->cols; ++x) (*plane)(y, x) = static_cast<std::uint8_t>(random() % 256);
    }
  }
  return image;
}

// Mean of the pixels of `plane` that lie under half pixel (x, y), for a plane `shift` times smaller than
// luma.
float Under(const cv::Mat1b& plane, int x, int y, int shift_x, int shift_y) {
  float sum = 0;
  for (int k = 0; k < 4; ++k) {
    const int u = (2 * x + k % 2) >> shift_x, v = (2 * y + k / 2) >> shift_y;
    sum += static_cast<float>(plane(std::min(v, plane.rows - 1), std::min(u, plane.cols - 1)));
  }
  return sum / 4;
}

TEST(HalfRgb, FollowsTheJfifEquationsForEveryLayoutAndOddSizes) {
  for (const ChromaLayout layout : {ChromaLayout::k444, ChromaLayout::k422, ChromaLayout::k420}) {
    for (const cv::Size size :
         {cv::Size(2, 2), cv::Size(67, 9), cv::Size(128, 6), cv::Size(131, 33), cv::Size(17, 1)}) {
      const YuvImage image = Random(size.width, size.height, layout);
      HalfPicture half;
      HalfRgb(image, &half);
      ASSERT_EQ(half.r.size(), cv::Size(Half(size.width), Half(size.height)));
      const int sx = ChromaShiftX(layout), sy = ChromaShiftY(layout);
      for (int y = 0; y < half.height(); ++y) {
        for (int x = 0; x < half.width(); ++x) {
          const float luma = Under(image.y, x, y, 0, 0);
          const float cb = Under(image.cb, x, y, sx, sy) - 128, cr = Under(image.cr, x, y, sx, sy) - 128;
          const auto near = [](float exact, int got) {
            return std::abs(std::clamp(exact, 0.0f, 255.0f) - static_cast<float>(got)) <= 2.0f;
          };
          ASSERT_TRUE(near(luma + 1.402f * cr, half.r(y, x))) << size << " " << x << "," << y;
          ASSERT_TRUE(near(luma - 0.344136f * cb - 0.714136f * cr, half.g(y, x)))
              << size << " " << x << "," << y;
          ASSERT_TRUE(near(luma + 1.772f * cb, half.b(y, x))) << size << " " << x << "," << y;
        }
      }
    }
  }
}

}  // namespace
}  // namespace mixstage
