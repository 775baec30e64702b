// SPDX-License-Identifier: Apache-2.0
//
// A tiny room with exact truth for the key's tests: a textured wall at a known depth, seeded noise, painted
// rectangles.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <random>
#include <utility>

#include "proto/base/image_view.h"
#include "server/segmentation/background_estimator.h"

namespace mixstage {

// Luma at full size, as coarse as the colours.
inline cv::Mat1b LumaOf(const HalfPicture& picture, int width, int height) {
  cv::Mat1b luma(height, width);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      luma(y, x) = cv::saturate_cast<std::uint8_t>(0.299f * picture.r(y / 2, x / 2) +
                                                   0.587f * picture.g(y / 2, x / 2) +
                                                   0.114f * picture.b(y / 2, x / 2));
    }
  }
  return luma;
}

class FlatRoom {
 public:
  FlatRoom(int width, int height, float depth_m) : width_(width), height_(height), depth_m_(depth_m) {}

  // A frame of the empty room: gain on every colour, normal noise of `sigma` levels and `sigma_m` metres.
  void Shoot(float gain = 1, float sigma = 1.5f, float sigma_m = 0.01f) {
    const int w = Half(width_), h = Half(height_);
    for (cv::Mat1b* plane : {&picture.r, &picture.g, &picture.b}) plane->create(h, w);
    depth.create(height_, width_);
    std::normal_distribution<float> noise(0, 1);
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const float texture = 20.0f * static_cast<float>((x / 5 + y / 7) % 2);
        picture.r(y, x) = cv::saturate_cast<std::uint8_t>(gain * (110 + texture) + sigma * noise(random_));
        picture.g(y, x) = cv::saturate_cast<std::uint8_t>(gain * (100 + texture) + sigma * noise(random_));
        picture.b(y, x) = cv::saturate_cast<std::uint8_t>(gain * (90 + texture) + sigma * noise(random_));
      }
    }
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) depth(y, x) = depth_m_ + sigma_m * noise(random_);
    }
  }
  // Full-size rectangle of an actor.
  void PaintColor(cv::Rect full, int r, int g, int b) {
    const cv::Rect half(full.x / 2, full.y / 2, full.width / 2, full.height / 2);
    picture.r(half).setTo(r);
    picture.g(half).setTo(g);
    picture.b(half).setTo(b);
  }
  void PaintDepth(cv::Rect full, float z_m) { depth(full).setTo(z_m); }
  void Darken(cv::Rect full, float factor) {
    const cv::Rect half(full.x / 2, full.y / 2, full.width / 2, full.height / 2);
    for (cv::Mat1b* plane : {&picture.r, &picture.g, &picture.b}) {
      cv::Mat part = (*plane)(half);
      part.convertTo(part, -1, factor);
    }
  }
  [[nodiscard]] ImageView<const std::uint8_t> Luma() {
    luma = LumaOf(picture, width_, height_);
    return View(std::as_const(luma));
  }
  [[nodiscard]] ImageView<const float> Depth() const { return View(depth); }

  BackgroundModel Learn(int frames) {
    auto estimator = BackgroundEstimator::Create({}, width_, height_).value();
    for (int i = 0; i < frames; ++i) {
      Shoot();
      estimator.Add(picture, Depth());
    }
    return estimator.EstimateEmpty().value();
  }

  HalfPicture picture;
  cv::Mat1f depth;
  cv::Mat1b luma;

 private:
  int width_;
  int height_;
  float depth_m_;
  std::mt19937 random_{7};
};

}  // namespace mixstage
