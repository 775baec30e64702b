// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/range_samples.h"

#include <algorithm>
#include <cmath>

namespace mixstage {
namespace {

constexpr double kInsideOutline_px = 2.5;

// Side of a square in the picture where it is smallest, px.
double SmallestSquare(const Lens& lens, const RigidTransform& T_camera_board, const Board& board) {
  double smallest = 1e9;
  for (int i = 0; i < board.corners(); ++i) {
    const Eigen::Vector3d corner = board.Corner(i);
    const auto p = lens.Project(T_camera_board * corner);
    for (const Eigen::Vector3d& step :
         {Eigen::Vector3d(board.square_m, 0, 0), Eigen::Vector3d(0, board.square_m, 0)}) {
      const auto q = lens.Project(T_camera_board * (corner + step));
      if (p && q) smallest = std::min(smallest, (*q - *p).norm());
    }
  }
  return smallest;
}

}  // namespace

void AppendRangeSamples(const Lens& lens, const RigidTransform& T_camera_board, const Board& board,
                        const cv::Mat1w& range, const cv::Mat1w& amplitude, const RangePictureScale& scale,
                        std::size_t view, std::vector<RangeSample>& samples) {
  const double square_px = SmallestSquare(lens, T_camera_board, board);
  const double border = 1 + board.white_margin_m / board.square_m - kInsideOutline_px / square_px;
  const RigidTransform T_board_camera = T_camera_board.inverse();
  const Eigen::Vector3d origin = T_board_camera.translation();
  const bool bright_known = amplitude.size() == range.size();
  for (int v = 0; v < range.rows; ++v) {
    for (int u = 0; u < range.cols; ++u) {
      if (range(v, u) == 0 || (bright_known && amplitude(v, u) == 0)) continue;
      const auto ray = lens.Unproject({u, v});
      if (!ray) continue;
      const Eigen::Vector3d direction = T_board_camera.linear() * *ray;
      const double along = -origin.z() / direction.z();
      if (!(along > 0)) continue;
      const Eigen::Vector3d p = (origin + along * direction) / board.square_m;
      if (p.x() < -border || p.y() < -border || p.x() > board.columns - 1 + border ||
          p.y() > board.rows - 1 + border)
        continue;
      RangeSample s{along, range(v, u) * scale.unit_m, bright_known ? double(amplitude(v, u)) : 1.0, view};
      if (scale.measures_z) s.measured_m /= ray->z();
      if (scale.unambiguous_range_m) {
        const double wrap = *scale.unambiguous_range_m;
        s.measured_m += wrap * std::round((along - s.measured_m) / wrap);
      }
      samples.push_back(s);
    }
  }
}

}  // namespace mixstage
