// SPDX-License-Identifier: Apache-2.0
//
// The joint adjustment on pixels instead of corners, MixIn3D 2.1: every picture of a board is one block of
// residuals (board_picture_fit.h), condensed to as many rows as it has parameters, so that Ceres sees the
// exact cost and Gauss-Newton matrix of some thousand pixels as 25 numbers. Boards that reach out of a
// picture take part with what is in it.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "proto/base/result.h"
#include "server/calibration/adjustment_summary.h"
#include "server/calibration/board_picture_fit.h"
#include "server/calibration/deviations.h"

namespace mixstage {

// Brightness [h x w] of a camera's picture of a view, proportional to light; nothing where there is none.
using BrightnessOf = std::function<std::optional<cv::Mat1f>(std::size_t camera, std::size_t view_index)>;

struct FittedPicture {
  std::size_t camera = 0, placement = 0;
  BoardPictureFit fit;
};

// Every placement with a pose in every posed camera's picture of it, where the picture shows the board;
// sightings that are left out stay out. On all cores: brightness_of is called from several threads at once.
[[nodiscard]] std::vector<FittedPicture> FitPictures(const BoardScene& scene,
                                                     const BrightnessOf& brightness_of);

// Adjusts cameras and boards that are not held out to the pictures; then held-out boards' poses to the
// cameras.
Result<AdjustmentSummary> AdjustToPixels(const std::vector<FittedPicture>& pictures, BoardScene& scene,
                                         int most_iterations);

// Deviations that these pictures leave.
Result<Deviations> DeviationsByPixels(const std::vector<FittedPicture>& pictures, const BoardScene& scene);

}  // namespace mixstage
