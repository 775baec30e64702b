// SPDX-License-Identifier: Apache-2.0
//
// A lens from boards alone, before anything is known of the other cameras. algorithms: cv::calibrateCamera
// (pinhole); for the fisheye an equidistant guess of several focal lengths, the best of them adjusted to
// Kannala-Brandt (cv::fisheye is not used: it takes atan(r / z) and breaks at 90 degrees).
#pragma once

#include <optional>
#include <vector>

#include "proto/base/result.h"
#include "server/calibration/board_scene.h"

namespace mixstage {

enum class CornerKind {
  kSaddle = 1,  // BoardSighting::pixels
  kGradient,    // BoardSighting::gradient_pixels
};

struct LensStart {
  Lens lens;
  double rms_px = 0;  // of the sightings it rests on
  int sightings = 0;
  CornerKind corners = CornerKind::kSaddle;  // which of them fit a lens better, by 2 % or more
};

// From whole boards; at least 3. `guess` has the kind, the size and the numbers to be estimated; its numbers
// are a start for the fisheye and unused for the pinhole. Fails (kQualityGate) with too few boards or where
// none of the starts fits.
Result<LensStart> StartLens(const Lens& guess, const std::vector<Board>& boards,
                            const std::vector<BoardSighting>& sightings);

// Makes the scene's corners of a camera those that its start chose.
void UseCorners(BoardScene& scene, std::size_t camera, CornerKind kind);

// What is assumed of a camera without a data sheet: a pinhole of 60 degrees, or a fisheye whose picture's
// smaller side spans 190 degrees; principal point in the centre, no distortion.
[[nodiscard]] Lens AssumedLens(LensKind kind, int width_px, int height_px);

}  // namespace mixstage
