// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/calibration/board_file.h"

namespace mixstage {
namespace {

constexpr double kSameInstant_s = 0.05;

// Half the smallest step of a list: two of its pictures never share a view.
double HalfStep(const std::vector<TakeEntry>& entries) {
  double step = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < entries.size(); ++i) step = std::min(step, entries[i].t_s - entries[i - 1].t_s);
  return 0.5 * step;
}

// Puts every picture of a list into the view of its instant, or into a view of its own.
void Assign(std::vector<BoardView>& views, const std::vector<TakeEntry>& entries, double offset_s,
            const std::string& folder, std::optional<std::filesystem::path> BoardView::*slot) {
  const double tolerance = std::min(kSameInstant_s, HalfStep(entries));
  const std::size_t known = views.size();
  for (const TakeEntry& entry : entries) {
    const double t_s = entry.t_s + offset_s;
    BoardView* nearest = nullptr;
    for (std::size_t i = 0; i < known; ++i) {
      const double d = std::abs(views[i].t_s - t_s);
      if (d <= tolerance && (!nearest || d < std::abs(nearest->t_s - t_s))) nearest = &views[i];
    }
    if (!nearest || nearest->*slot) {
      if (nearest) continue;  // a second picture of the same instant: the nearer one came first or is as good
      nearest = &views.emplace_back();
      nearest->name = folder + "/" + entry.stem();
      nearest->t_s = t_s;
    }
    nearest->*slot = entry.file;
  }
}

}  // namespace

Result<ViewFolder> OpenViewFolder(const std::filesystem::path& path, double depth_time_offset_s,
                                  double fisheye_time_offset_s) {
  auto take = OpenPictureLists(path);
  if (!take) return tl::unexpected(take.error());
  auto boards = LoadBoards(take->folder / "board.json");
  if (!boards) return tl::unexpected(boards.error());
  ViewFolder folder;
  folder.folder = take->folder;
  folder.boards = std::move(*boards);
  folder.warnings = std::move(take->warnings);
  const std::string name = take->folder.filename().string();
  Assign(folder.views, take->color, 0, name, &BoardView::color);
  Assign(folder.views, take->amplitude, depth_time_offset_s, name, &BoardView::amplitude);
  Assign(folder.views, take->depth, depth_time_offset_s, name, &BoardView::depth);
  Assign(folder.views, take->fisheye, fisheye_time_offset_s, name, &BoardView::fisheye);
  std::stable_sort(folder.views.begin(), folder.views.end(),
                   [](const BoardView& a, const BoardView& b) { return a.t_s < b.t_s; });
  for (BoardView& view : folder.views) {
    const auto near = std::min_element(take->head.begin(), take->head.end(), [&](auto& a, auto& b) {
      return std::abs(a.t_s - view.t_s) < std::abs(b.t_s - view.t_s);
    });
    if (near != take->head.end() && std::abs(near->t_s - view.t_s) <= kSameInstant_s) view.head = *near;
  }
  return folder;
}

}  // namespace mixstage
