// SPDX-License-Identifier: Apache-2.0
#include "server/environment/openings.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "proto/base/median.h"
#include "proto/base/text.h"

namespace mixstage {
namespace {

constexpr double kLeastArea_m2 = 0.1;    // of an opening
constexpr double kLeastPlane_m2 = 1;     // of the surface that it interrupts
constexpr double kLeastBehind_m = 0.15;  // deeper than a shelf's rim or a relief
constexpr double kSigmas = 5;            // of a node's own depth
constexpr double kFramed = 0.6;    // share of what is around it that is surface: a hole in it, not its end
constexpr double kFrame_m = 0.1;   // a mirror's or a window's frame stands off the wall by less
constexpr double kSame_m = 0.1;    // a mirrored point lies on the room's surface
constexpr double kMirrored = 0.5;  // share of what is known that does

class Finder {
 public:
  Finder(const SurfaceNodes& nodes, const std::vector<GrownPlane>& planes, const PanoramaGrid& grid)
      : n_(nodes), planes_(planes), grid_(grid), center_(grid.panorama().center) {}

  void FindBehind(std::size_t plane, const RoomPlane& described, std::vector<Opening>& out) const {
    const std::vector<cv::Point2f> outline = Outline(plane, described);
    if (outline.size() < 3) return;
    cv::Mat1b behind = Mask();
    for (int y = 0; y < n_.height; ++y) {
      for (int x = 0; x < n_.width; ++x) {
        const std::size_t i = Index(x, y);
        if (n_.plane[i].isZero() || n_.inverse_range[i] <= 0) continue;
        const double on_plane = planes_[plane].m.dot(Ray(i)), seen = n_.inverse_range[i];
        if (on_plane <= 0 || on_plane - seen < kSigmas * static_cast<double>(n_.sigma[i]) ||
            1 / seen - 1 / on_plane < kLeastBehind_m)
          continue;
        if (cv::pointPolygonTest(outline, OnPlane(plane, Ray(i) / on_plane), false) > 0) behind(y, x) = 255;
      }
    }
    ForEachPart(behind, [&](const std::vector<cv::Point>& part, const cv::Mat1b& mask) {
      Opening o;
      o.plane = described.name;
      std::vector<double> depths;
      for (const cv::Point& p : part) {
        const std::size_t i = Index(p.x, p.y);
        const double on_plane = planes_[plane].m.dot(Ray(i));
        AddPatch(i, 1 / on_plane, on_plane / planes_[plane].m.norm(), o);
        depths.push_back(1 / static_cast<double>(n_.inverse_range[i]) - 1 / on_plane);
      }
      if (o.area_m2 < kLeastArea_m2 || Framed(mask, plane) < kFramed) return;
      o.at /= static_cast<double>(part.size());
      o.behind_m = Median(depths);
      o.kind = ShowsTheRoom(part, plane) ? Opening::Kind::kMirror : Opening::Kind::kBehind;
      out.push_back(o);
    });
  }

  void FindNoRange(const std::vector<std::uint8_t>& swept, std::vector<Opening>& out) const {
    cv::Mat1b missing = Mask();
    for (int y = 0; y < n_.height; ++y)
      for (int x = 0; x < n_.width; ++x)
        if (swept[Index(x, y)] != 0 && n_.plane[Index(x, y)].isZero()) missing(y, x) = 255;
    ForEachPart(missing, [&](const std::vector<cv::Point>& part, const cv::Mat1b& mask) {
      std::vector<double> ranges;  // of what is around it
      const double around = ForEachAround(mask, 1, 2, [&](std::size_t i) {
        if (n_.inverse_range[i] > 0) ranges.push_back(1 / static_cast<double>(n_.inverse_range[i]));
      });
      // The sweep's rim, where the colour camera looks farther than the depth camera, is none.
      if (static_cast<double>(ranges.size()) <= kFramed * around) return;
      const double range = Median(ranges);
      Opening o;
      for (const cv::Point& p : part) AddPatch(Index(p.x, p.y), range, 1, o);
      if (o.area_m2 < kLeastArea_m2) return;
      o.at /= static_cast<double>(part.size());
      out.push_back(o);
    });
  }

 private:
  [[nodiscard]] std::size_t Index(int x, int y) const { return static_cast<std::size_t>(n_.At(x, y)); }
  [[nodiscard]] Eigen::Vector3d Ray(std::size_t i) const { return n_.ray[i].cast<double>(); }
  [[nodiscard]] cv::Mat1b Mask() const { return cv::Mat1b(n_.height, n_.width, std::uint8_t{0}); }

  // A node's patch of a surface at `range` that is seen with this cosine.
  void AddPatch(std::size_t i, double range, double cosine, Opening& o) const {
    const Eigen::Vector3d ray = Ray(i);
    const double side_m = grid_.step_rad() * n_.step * range;
    // Columns are narrower away from the horizon.
    o.area_m2 += side_m * side_m * std::hypot(ray.x(), ray.y()) / cosine;
    o.at += center_ + range * ray;
  }

  // A point, seen from the centre, in two axes of the plane.
  [[nodiscard]] cv::Point2f OnPlane(std::size_t plane, const Eigen::Vector3d& from_center) const {
    const Eigen::Vector3d n = planes_[plane].m.normalized();
    const Eigen::Vector3d u = n.unitOrthogonal();
    return {static_cast<float>(u.dot(from_center)), static_cast<float>(n.cross(u).dot(from_center))};
  }

  [[nodiscard]] std::vector<cv::Point2f> Outline(std::size_t plane, const RoomPlane& described) const {
    std::vector<cv::Point2f> outline;
    for (const Eigen::Vector3d& corner : described.polygon)
      outline.push_back(OnPlane(plane, corner - center_));
    return outline;
  }

  // Calls each(pixels, mask) for the connected parts; strips of one node are what edges leave.
  template <typename Each>
  void ForEachPart(const cv::Mat1b& mask, Each each) const {
    cv::Mat1b opened;
    cv::morphologyEx(mask, opened, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
    cv::Mat1i label;
    const int count = cv::connectedComponents(opened, label, 8, CV_32S);
    std::vector<std::vector<cv::Point>> parts(static_cast<std::size_t>(count));
    for (int y = 0; y < label.rows; ++y)
      for (int x = 0; x < label.cols; ++x)
        if (label(y, x) > 0) parts[static_cast<std::size_t>(label(y, x))].emplace_back(x, y);
    constexpr std::size_t kLeastNodes = 30;
    for (std::size_t k = 1; k < parts.size(); ++k) {
      if (parts[k].size() < kLeastNodes) continue;
      cv::Mat1b part;
      cv::compare(label, static_cast<int>(k), part, cv::CMP_EQ);
      each(parts[k], part);
    }
  }

  // Calls each(node) for those from `from` to `to` nodes beyond the part's edge. How many there would be if
  // the grid had no end.
  template <typename Each>
  double ForEachAround(const cv::Mat1b& mask, int from, int to, Each each) const {
    cv::Mat1b part, outer, inner;
    cv::copyMakeBorder(mask, part, to, to, to, to, cv::BORDER_CONSTANT, 0);
    auto square = [](int reach) {
      return cv::getStructuringElement(cv::MORPH_RECT, {2 * reach + 1, 2 * reach + 1});
    };
    cv::dilate(part, outer, square(to));
    cv::dilate(part, inner, square(from - 1));
    double around = 0;
    for (int y = 0; y < part.rows; ++y) {
      for (int x = 0; x < part.cols; ++x) {
        if (outer(y, x) == inner(y, x)) continue;
        ++around;
        if (const int node = n_.At(x - to, y - to); node >= 0) each(static_cast<std::size_t>(node));
      }
    }
    return around;
  }

  // Share of what is around a part that lies on the plane or as near as a frame does. Depths right at an edge
  // are mixed.
  [[nodiscard]] double Framed(const cv::Mat1b& mask, std::size_t plane) const {
    double on = 0;
    const double around = ForEachAround(mask, 3, 5, [&](std::size_t i) {
      const double on_plane = planes_[plane].m.dot(Ray(i));
      if (n_.plane[i].isZero() || on_plane <= 0) return;
      on += n_.room_plane[i] == static_cast<int>(plane) ||
            std::abs(1 / static_cast<double>(n_.plane[i].dot(n_.ray[i])) - 1 / on_plane) < kFrame_m;
    });
    return on / around;
  }

  // What the part shows, mirrored in the plane, is where the room itself has a surface.
  [[nodiscard]] bool ShowsTheRoom(const std::vector<cv::Point>& part, std::size_t plane) const {
    constexpr double kLeastKnown =
        0.2;  // of the part: a mirror that faces the camera shows what is behind it
    const Eigen::Vector3d n = planes_[plane].m.normalized();
    const double distance = 1 / planes_[plane].m.norm();
    double known = 0, same = 0;
    for (const cv::Point& p : part) {
      const std::size_t i = Index(p.x, p.y);
      const Eigen::Vector3d seen = Ray(i) / static_cast<double>(n_.inverse_range[i]);
      const Eigen::Vector3d real = seen - 2 * (n.dot(seen) - distance) * n;
      const Eigen::Vector2d at = grid_.PixelNear(real, grid_.width() / 2.0);
      const int node = n_.At(static_cast<int>(std::floor((at.x() + 0.5) / n_.step)),
                             static_cast<int>(std::floor((at.y() + 0.5) / n_.step)));
      if (node < 0 || n_.plane[static_cast<std::size_t>(node)].isZero()) continue;
      const auto j = static_cast<std::size_t>(node);
      ++known;
      const double room = 1 / static_cast<double>(n_.plane[j].dot(n_.ray[j]));
      const double sigma_m = static_cast<double>(n_.sigma[i]) * seen.squaredNorm();
      same += std::abs(room - real.norm()) < kSame_m + 2 * sigma_m;
    }
    return known > kLeastKnown * static_cast<double>(part.size()) && same > kMirrored * known;
  }

  const SurfaceNodes& n_;
  const std::vector<GrownPlane>& planes_;
  const PanoramaGrid& grid_;
  Eigen::Vector3d center_;
};

}  // namespace

std::vector<Opening> FindOpenings(const SurfaceNodes& nodes, const std::vector<GrownPlane>& planes,
                                  const std::vector<RoomPlane>& described,
                                  const std::vector<std::uint8_t>& swept, const PanoramaGrid& grid) {
  const Finder finder(nodes, planes, grid);
  std::vector<Opening> out;
  for (std::size_t k = 0; k < described.size(); ++k)
    if (planes[k].area_m2 >= kLeastPlane_m2) finder.FindBehind(k, described[k], out);
  finder.FindNoRange(swept, out);
  std::stable_sort(out.begin(), out.end(),
                   [](const Opening& a, const Opening& b) { return a.area_m2 > b.area_m2; });
  return out;
}

std::string Described(const Opening& o) {
  const std::string where = Text("%.2f m2 at %.2f, %.2f, %.2f m", o.area_m2, o.at.x(), o.at.y(), o.at.z());
  constexpr const char* kKeptOut = "a garbage region there (regions.yaml) keeps mirrored actors out";
  switch (o.kind) {
    case Opening::Kind::kMirror:
      return Text("%s has a mirror of %s: it shows the room once more, %.1f m behind it; %s", o.plane.c_str(),
                  where.c_str(), o.behind_m, kKeptOut);
    case Opening::Kind::kBehind:
      return Text(
          "%s has an opening of %s, through which is seen what lies %.1f m behind it: a doorway, a "
          "window or a mirror; if it mirrors, %s",
          o.plane.c_str(), where.c_str(), o.behind_m, kKeptOut);
    case Opening::Kind::kNoRange:
      break;
  }
  return Text("%s gave no range: a window, something black or too far; filled in from what is around it",
              where.c_str());
}

}  // namespace mixstage
