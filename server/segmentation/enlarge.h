// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "proto/base/image_view.h"

namespace mixstage {

// Twice the width and height by linear interpolation at the true siting (pixel (x, y) of `from` covers
// 2x..2x+1, 2y..2y+1 of `to`), cut to the size of `to`, which must be at most twice `from` and at least that
// less one.
void EnlargeTwice(const cv::Mat1b& from, ImageView<std::uint8_t> to);

}  // namespace mixstage
