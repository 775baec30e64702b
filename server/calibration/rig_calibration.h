// SPDX-License-Identifier: Apache-2.0
//
// The calibration of a head's cameras from views of boards, start to end, MixIn3D 2.1: detection, a start of
// every camera, the joint adjustment on corners, then on pixels, the ToF camera's range error, the head that
// carries them; and what says whether it is good enough.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/calibration/deviations.h"
#include "server/calibration/hand_eye.h"
#include "server/calibration/range_curve.h"
#include "server/calibration/view_detection.h"

namespace mixstage {

// OpenCV on the same corners, beside ours.
struct OpenCvFigures {
  double single_rms_px = 0;  // cv::calibrateCamera (k1, k2); 0 for a fisheye
  double stereo_rms_px = 0;  // cv::stereoCalibrate with the first camera, lenses fixed; 0 = not run
};

struct CameraFigures {
  int boards = 0;     // sightings that took part
  double rms_px = 0;  // of their corners
  double held_out_rms_px = 0;
  int held_out_boards = 0;
  OpenCvFigures opencv;
  int fitted_pictures = 0;  // compared pixel by pixel
  std::size_t fitted_pixels = 0;
  double spot_px = 0;                    // sigma of the picture's spot, median
  double nearest_m = 0, farthest_m = 0;  // of the boards' middles
  double most_tilted_deg = 0;            // 95th percentile of the angle between a board's normal and its ray
  double covered = 0;                    // share of 8 x 6 fields of the picture that hold a corner
  double seen_to_deg = 0;                // 99th percentile of the corners' angle from the axis
};

struct RigCalibration {
  Rig rig;  // the nominal one with everything that was calibrated
  BoardScene scene;
  std::vector<BoardView> views;
  std::vector<PictureNote> notes;
  std::vector<CameraFigures> figures;  // per camera of the scene
  Deviations deviations;
  std::optional<RangeCurve> range;
  std::optional<HandEyeResult> hand_eye;  // where the head turned before boards that stood still
  std::vector<std::string> warnings;
  std::vector<std::string> failed_gates;  // why this is no calibration to work with; empty = it is
  std::vector<std::string> advice;        // what views would make it better
};

// stage(what) before each stage, with a count while pictures are searched. Fails (kBadInput) where nothing
// can be read; poor views are no failure but failed_gates.
Result<RigCalibration> CalibrateRig(const std::vector<ViewFolder>& folders, const NominalRig& nominal,
                                    const std::function<void(const std::string&)>& stage);

}  // namespace mixstage
