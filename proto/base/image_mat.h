// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <type_traits>

#include "proto/base/image_view.h"

namespace mixstage {

// A view as a picture of OpenCV's, which borrows it and, where it is const, only reads it.
template <typename T>
[[nodiscard]] cv::Mat_<std::remove_const_t<T>> AsMat(ImageView<T> view) {
  return {view.height(), view.width(), const_cast<std::remove_const_t<T>*>(view.data()),
          static_cast<std::size_t>(view.stride()) * sizeof(T)};
}

}  // namespace mixstage
