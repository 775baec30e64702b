// SPDX-License-Identifier: Apache-2.0
#include "server/environment/moved_things.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/median.h"

namespace mixstage {
namespace {

constexpr float kSigmas = 5;
constexpr float kLeast_m = 0.1f;        // a step that is an edge (SurfaceMeshConfig::cut_m)
constexpr double kLeastArea_m2 = 0.02;  // a book
constexpr double kEdge_pixels = 3;  // of the depth camera: around edges views differ by what they can resolve

// Where the view sees something nearer than the room, or farther. 255 and 0.
cv::Mat1b Contradictions(const PanoramaPatch& patch, const FusedDepth& fused, const PanoramaGrid& grid,
                         bool nearer) {
  cv::Mat1b out(patch.inverse_range.size(), std::uint8_t{0});
  for (int y = 0; y < out.rows; ++y) {
    for (int x = 0; x < out.cols; ++x) {
      const float seen = patch.inverse_range(y, x);
      const int column = seen > 0 ? grid.Column(patch.x0 + x) : -1;
      if (column < 0) continue;
      const float room = fused.inverse_range(patch.y0 + y, column);
      if (room <= 0) continue;
      const float off = nearer ? seen - room : room - seen;
      if (off > kSigmas * std::hypot(patch.sigma(y, x), fused.sigma(patch.y0 + y, column)) &&
          off > kLeast_m * seen * room)
        out(y, x) = 255;
    }
  }
  return out;
}

// The connected parts of a view's contradictions that are wider than `kernel` and no specks.
void AddThings(const PanoramaPatch& patch, std::size_t view, const FusedDepth& fused,
               const PanoramaGrid& grid, bool nearer, const cv::Mat& kernel, std::vector<MovedThing>& out) {
  cv::Mat1b mask = Contradictions(patch, fused, grid, nearer);
  cv::morphologyEx(mask, mask, cv::MORPH_OPEN, kernel);
  cv::Mat1i label;
  const int count = cv::connectedComponents(mask, label, 8, CV_32S);
  std::vector<MovedThing> things(static_cast<std::size_t>(count));
  std::vector<std::vector<float>> steps_m(things.size());
  const Eigen::Vector3f center = grid.panorama().center.cast<float>();
  for (int y = 0; y < label.rows; ++y) {
    for (int x = 0; x < label.cols; ++x) {
      const auto n = static_cast<std::size_t>(label(y, x));
      if (n == 0) continue;
      const int column = grid.Column(patch.x0 + x);
      const Eigen::Vector3f ray = grid.Ray(column, patch.y0 + y);
      const float seen_m = 1 / patch.inverse_range(y, x),
                  room_m = 1 / fused.inverse_range(patch.y0 + y, column);
      const double side_m = grid.step_rad() * std::min(seen_m, room_m);
      // Columns are narrower away from the horizon.
      things[n].area_m2 += side_m * side_m * std::hypot(ray.x(), ray.y());
      things[n].dots.push_back({center + seen_m * ray, center + room_m * ray});
      steps_m[n].push_back(room_m - seen_m);
    }
  }
  for (std::size_t n = 1; n < things.size(); ++n) {
    MovedThing& thing = things[n];
    if (thing.area_m2 < kLeastArea_m2) continue;
    thing.view = view;
    for (const auto& dot : thing.dots)
      thing.at += dot[0].cast<double>() / static_cast<double>(thing.dots.size());
    thing.nearer_m = Median(steps_m[n]);
    out.push_back(std::move(thing));
  }
}

}  // namespace

std::vector<MovedThing> FindMovedThings(const std::vector<PanoramaPatch>& patches, const FusedDepth& fused,
                                        const PanoramaGrid& grid, float pitch_rad) {
  const int side = std::max(3, static_cast<int>(std::lround(kEdge_pixels * pitch_rad / grid.step_rad())));
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {side, side});
  std::vector<std::vector<MovedThing>> of_view(patches.size());
  cv::parallel_for_({0, static_cast<int>(patches.size())}, [&](const cv::Range& views) {
    for (int k = views.start; k < views.end; ++k) {
      const auto i = static_cast<std::size_t>(k);
      if (patches[i].inverse_range.empty()) continue;
      for (const bool nearer : {true, false})
        AddThings(patches[i], i, fused, grid, nearer, kernel, of_view[i]);
    }
  });
  std::vector<MovedThing> all;
  for (auto& things : of_view)
    for (MovedThing& thing : things) all.push_back(std::move(thing));
  std::stable_sort(all.begin(), all.end(),
                   [](const MovedThing& a, const MovedThing& b) { return a.area_m2 > b.area_m2; });
  return all;
}

void HideMovedThings(const std::vector<MovedThing>& things, const PinholeCamera& camera,
                     const std::vector<PosedPicture>& views, float pitch_rad,
                     std::vector<ViewOcclusion>& occlusions) {
  std::vector<cv::Mat1b> marks(views.size());
  for (const MovedThing& thing : things) {
    ViewOcclusion& occlusion = occlusions[thing.view];
    cv::Mat1b& mark = marks[thing.view];
    if (mark.empty()) mark = cv::Mat1b::zeros(occlusion.depth_m.size());
    const RigidTransform T_color_world = views[thing.view].T_world_color.inverse();
    const double shrink = static_cast<double>(camera.width) / mark.cols;
    for (const auto& dot : thing.dots) {
      for (const Eigen::Vector3f& p : dot) {
        const auto pixel = camera.Project(T_color_world * p.cast<double>());
        if (!pixel) continue;
        const cv::Point at(static_cast<int>(std::lround(pixel->x() / shrink)),
                           static_cast<int>(std::lround(pixel->y() / shrink)));
        if (cv::Rect(0, 0, mark.cols, mark.rows).contains(at)) mark(at) = 255;
      }
    }
  }
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (marks[i].empty()) continue;
    // Dots lie apart, and the depth camera's pixels are coarse: what moved reaches a pixel and a half of it
    // farther.
    const double shrink = static_cast<double>(camera.width) / marks[i].cols;
    const int side = 1 + 2 * static_cast<int>(std::ceil(1.5 * pitch_rad * camera.fx / shrink));
    cv::dilate(marks[i], marks[i], cv::getStructuringElement(cv::MORPH_RECT, {side, side}));
    occlusions[i].depth_m.setTo(1e-3f, marks[i]);
  }
}

}  // namespace mixstage
