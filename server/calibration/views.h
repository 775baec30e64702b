// SPDX-License-Identifier: Apache-2.0
//
// A folder of views: pictures of boards in the layout of a take (SPEC.md 5) with board.json beside the lists.
// What the cameras saw at one instant is a view. Any list may be missing.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/board.h"
#include "proto/geometry/rig.h"
#include "proto/take/take.h"

namespace mixstage {

struct BoardView {
  std::string name;  // folder/stem of its first picture
  double t_s = 0;    // on the colour camera's clock
  // depth is the ToF camera's range picture, amplitude its brightness.
  std::optional<std::filesystem::path> color, depth, amplitude, fisheye;
  std::optional<HeadSample> head;  // where ptu.txt has a line at this instant
};

struct ViewFolder {
  std::filesystem::path folder;
  std::vector<Board> boards;
  std::vector<BoardView> views;       // in the order of time
  std::vector<std::string> warnings;  // lines and files that were left out, by name
};

// Pictures within 50 ms of each other, and nearer to each other than half the way to their neighbours in
// their own list, are one view. Fails where a list or board.json cannot be used (kBadInput, the file named).
Result<ViewFolder> OpenViewFolder(const std::filesystem::path& folder, double depth_time_offset_s,
                                  double fisheye_time_offset_s);

}  // namespace mixstage
