// SPDX-License-Identifier: Apache-2.0
//
// ImageView<T>: a borrowed picture (pointer, width, height, stride). Passed by value, never stored beyond the
// call. Owners are cv::Mat_<T>; a published picture is owned by a shared_ptr<const ...> and immutable.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <type_traits>

#include "proto/base/check.h"

namespace mixstage {

template <typename T>
class ImageView {
 public:
  ImageView() = default;
  // stride: elements (not bytes) from one row to the next, >= width.
  ImageView(T* data, int width, int height, std::ptrdiff_t stride)
      : data_(data), width_(width), height_(height), stride_(stride) {
    MIX_CHECK(width >= 0 && height >= 0 && stride >= width);
  }
  // A view of a mutable picture is a view of a const one.
  operator ImageView<const T>() const  // NOLINT(google-explicit-constructor)
      requires(!std::is_const_v<T>) {
    return {data_, width_, height_, stride_};
  }

  [[nodiscard]] T* row(int y) const { return data_ + y * stride_; }
  [[nodiscard]] T& at(int x, int y) const { return data_[y * stride_ + x]; }
  [[nodiscard]] T* data() const { return data_; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] std::ptrdiff_t stride() const { return stride_; }
  [[nodiscard]] bool empty() const { return width_ == 0 || height_ == 0; }

 private:
  T* data_ = nullptr;
  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t stride_ = 0;
};

template <typename T>
[[nodiscard]] ImageView<T> View(cv::Mat_<T>& image) {
  return {image.empty() ? nullptr : image.template ptr<T>(0), image.cols, image.rows,
          image.empty() ? image.cols : static_cast<std::ptrdiff_t>(image.step1()) / image.channels()};
}
template <typename T>
[[nodiscard]] ImageView<const T> View(const cv::Mat_<T>& image) {
  return {image.empty() ? nullptr : image.template ptr<T>(0), image.cols, image.rows,
          image.empty() ? image.cols : static_cast<std::ptrdiff_t>(image.step1()) / image.channels()};
}

template <typename A, typename B>
[[nodiscard]] bool SameSize(ImageView<A> a, ImageView<B> b) {
  return a.width() == b.width() && a.height() == b.height();
}

}  // namespace mixstage
