// SPDX-License-Identifier: Apache-2.0
#include "server/environment/pose_order.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

namespace mixstage {
namespace {

constexpr int kMostLate = 2;
constexpr int kGreyWidth = 160;  // px: poses of the right order may still be a degree off

struct Sample {
  Eigen::Vector3d p;  // in the colour camera's frame
  double grey;
};

struct Seen {
  cv::Mat1f grey;
  double scale = 1;  // its pixels per pixel of the camera
  std::vector<Sample> samples;

  // Nothing outside of the picture.
  [[nodiscard]] std::optional<double> GreyAt(const PinholeCamera& color, const Eigen::Vector3d& p) const {
    if (p.z() < 0.1) return std::nullopt;
    const auto pixel = color.Project(p);
    if (!pixel) return std::nullopt;
    const int x = static_cast<int>(std::lround((pixel->x() + 0.5) * scale - 0.5));
    const int y = static_cast<int>(std::lround((pixel->y() + 0.5) * scale - 0.5));
    if (x < 0 || y < 0 || x >= grey.cols || y >= grey.rows) return std::nullopt;
    return grey(y, x);
  }
};

Seen See(const OrderedView& view, const RangeCamera& depth, const PinholeCamera& color) {
  constexpr int kEvery = 8;  // depth pixels
  Seen seen;
  seen.scale = static_cast<double>(kGreyWidth) / view.bgr.cols;
  cv::Mat1b grey;
  cv::cvtColor(view.bgr, grey, cv::COLOR_BGR2GRAY);
  cv::resize(grey, grey, {}, seen.scale, seen.scale, cv::INTER_AREA);
  grey.convertTo(seen.grey, CV_32F);
  const cv::Mat1f& range = view.range->range_m;
  for (int y = kEvery / 2; y < range.rows; y += kEvery) {
    for (int x = kEvery / 2; x < range.cols; x += kEvery) {
      const cv::Vec3f ray = depth.ray(y, x);
      if (range(y, x) <= 0 || !std::isfinite(ray[0])) continue;
      const Eigen::Vector3d p =
          depth.T_color_depth * (static_cast<double>(range(y, x)) * Eigen::Vector3d(ray[0], ray[1], ray[2]));
      if (const auto at = seen.GreyAt(color, p)) seen.samples.push_back({p, *at});
    }
  }
  return seen;
}

// Correlation of the brightnesses of common points, views taken with the poses of `late` views later; -1
// where too little is common.
double Agreement(const std::vector<Seen>& seen, const std::vector<OrderedView>& views,
                 const PinholeCamera& color, int late) {
  constexpr double kLeast = 300;
  double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  const int count = static_cast<int>(views.size());
  auto pose = [&](int i) { return views[static_cast<std::size_t>(i + late)].T_world_color; };
  const int first = std::max(0, -late), last = count - std::max(0, late);
  for (int i = first; i < last; ++i) {
    for (int j = first; j < last; ++j) {
      if (i == j) continue;
      const RigidTransform T_j_i = pose(j).inverse() * pose(i);
      for (const Sample& s : seen[static_cast<std::size_t>(i)].samples) {
        const auto other = seen[static_cast<std::size_t>(j)].GreyAt(color, T_j_i * s.p);
        if (!other) continue;
        n += 1, a += s.grey, b += *other;
        aa += s.grey * s.grey, bb += *other * *other, ab += s.grey * *other;
      }
    }
  }
  const double of_a = aa - a * a / n, of_b = bb - b * b / n;
  if (n < kLeast || of_a <= 0 || of_b <= 0) return -1;
  return (ab - a * b / n) / std::sqrt(of_a * of_b);
}

}  // namespace

int PosesLate(const std::vector<OrderedView>& views, const RangeCamera& depth, const PinholeCamera& color) {
  constexpr double kAgrees = 0.6, kFarBetter = 0.5;  // correlation; of what is left to a perfect one
  if (views.size() < 2 + kMostLate) return 0;
  std::vector<Seen> seen;
  for (const OrderedView& v : views) seen.push_back(See(v, depth, color));
  const double listed = Agreement(seen, views, color, 0);
  int best = 0;
  double agreement = listed;
  for (int late = -kMostLate; late <= kMostLate; ++late) {
    if (late == 0) continue;
    const double r = Agreement(seen, views, color, late);
    if (r > agreement) best = late, agreement = r;
  }
  return agreement > kAgrees && 1 - agreement < kFarBetter * (1 - listed) ? best : 0;
}

}  // namespace mixstage
