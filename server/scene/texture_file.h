// SPDX-License-Identifier: Apache-2.0
//
// Pictures inside or beside a model: PNG or JPEG, their size read from the header before anything is decoded.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <span>

#include "proto/base/result.h"

namespace mixstage {

// Width and height that a PNG or JPEG announces; fails for every other kind of picture.
Result<cv::Size> PictureSize(std::span<const std::uint8_t> bytes);

// Decodes to 8-bit sRGB R G B A. remaining_pixels: the model's texture budget (ModelLimits), lowered by the
// picture. Fails when a side is over 8192 px or the budget is spent.
Result<cv::Mat4b> DecodeTexture(std::span<const std::uint8_t> bytes, std::size_t& remaining_pixels);

}  // namespace mixstage
