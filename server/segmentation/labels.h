// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"

namespace mixstage {

// What a pixel shows; piVE 3's three labels. Shadow counts as background.
enum Label : std::uint8_t { kLabelBackground = 0, kLabelActor = 1, kLabelShadow = 2, kLabelUnknown = 255 };

// label [h x w] out: kLabelActor where alpha [h x w] >= 128, elsewhere what room_label [Half(h) x Half(w)]
// says.
void WriteLabels(ImageView<const std::uint8_t> alpha, const cv::Mat1b& room_label,
                 ImageView<std::uint8_t> label);

}  // namespace mixstage
