// SPDX-License-Identifier: Apache-2.0
//
// From folders of views to a scene: every picture is read and searched for its folder's boards, on all cores.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/calibration/board_scene.h"
#include "server/calibration/views.h"

namespace mixstage {

// The camera names of rig.json; amplitude pictures are the depth camera's.
inline constexpr const char* kColorName = "color";
inline constexpr const char* kDepthName = "depth";
inline constexpr const char* kFisheyeName = "fisheye";

struct NominalRig {
  Rig rig;
  bool given = false;  // else, and for cameras it lacks, sizes come from the pictures and all else is assumed
};

struct PictureNote {
  std::string file;
  std::string note;
};

struct DetectedViews {
  BoardScene scene;  // lenses nominal, nothing has a pose yet; cameras that have pictures, colour first
  std::vector<BoardView> views;    // of all folders
  std::vector<PictureNote> notes;  // pictures without a board, unreadable or blurred ones, and why
};

// Grey picture as it is searched and compared: luma of colour, counts of 16-bit pictures.
Result<cv::Mat> LoadGrey(const std::filesystem::path& file);

// Fails (kBadInput) where no picture can be read, or pictures of one camera differ in size from each other or
// from the nominal rig. progress(done, all) is called from one thread at a time.
Result<DetectedViews> DetectViews(const std::vector<ViewFolder>& folders, const NominalRig& nominal,
                                  const std::function<void(std::size_t, std::size_t)>& progress);

// Where a view's picture of a camera lies (amplitude for the depth camera).
[[nodiscard]] const std::optional<std::filesystem::path>& PictureOf(const BoardView& view,
                                                                    const std::string& camera);

// A camera of the scene by its name; nothing where it has no pictures.
[[nodiscard]] std::optional<std::size_t> CameraNamed(const BoardScene& scene, const std::string& name);

}  // namespace mixstage
