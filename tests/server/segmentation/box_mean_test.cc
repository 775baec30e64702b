// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/box_mean.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mixstage {
namespace {

TEST(BoxMean, IsTheRoundedMeanWithTheBorderRepeatedAtAnySize) {
  cv::theRNG().state = 5;
  for (int reach = 1; reach <= 7; ++reach) {
    BoxMean box(reach);
    for (const cv::Size size : {cv::Size(1, 1), cv::Size(3, 2), cv::Size(37, 11), cv::Size(130, 20)}) {
      cv::Mat1b from(size), mean;
      cv::randu(from, 0, 256);
      from.row(0).setTo(255);
      box.Run(from, &mean);
      for (int y = 0; y < size.height; ++y) {
        for (int x = 0; x < size.width; ++x) {
          int sum = 0;
          for (int v = y - reach; v <= y + reach; ++v) {
            for (int u = x - reach; u <= x + reach; ++u) {
              sum += from(std::clamp(v, 0, size.height - 1), std::clamp(u, 0, size.width - 1));
            }
          }
          const int area = (2 * reach + 1) * (2 * reach + 1);
          ASSERT_EQ(mean(y, x), (sum + area / 2) / area) << reach << ": " << x << ", " << y;
        }
      }
    }
  }
}

TEST(BoxMean, OfFloatsInPlaceIsTheMeanWithTheBorderRepeated) {
  cv::theRNG().state = 6;
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 3), cv::Size(1, 5), cv::Size(37, 11)}) {
    cv::Mat1f from(size);
    cv::randu(from, 0.0, 100.0);
    cv::Mat1f mean = from.clone();
    MeanOf3x3(&mean);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        float sum = 0;
        for (int v = y - 1; v <= y + 1; ++v) {
          for (int u = x - 1; u <= x + 1; ++u) {
            sum += from(std::clamp(v, 0, size.height - 1), std::clamp(u, 0, size.width - 1));
          }
        }
        ASSERT_NEAR(mean(y, x), sum / 9, 1e-3f) << x << ", " << y << " of " << size;
      }
    }
  }
}

}  // namespace
}  // namespace mixstage
