// SPDX-License-Identifier: Apache-2.0
#include "server/environment/join_rooms.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "server/environment/panorama_texture.h"

namespace mixstage {
namespace {

constexpr double kOnSurface_m = 0.05;       // from it, and
constexpr double kOnSurfaceOfRange = 0.01;  // of the range: what two scans of one surface may differ by
constexpr double kDegrees = 180 / std::numbers::pi;

// Where the rays of a scan ended.
class Sight {
 public:
  explicit Sight(const RoomScan& scan)
      : panorama_(scan.environment.panorama), range_mm_(scan.pictures.range_mm) {}

  [[nodiscard]] const Eigen::Vector3d& center() const { return panorama_.center; }

  // Range along the ray through p; 0 = the scan did not look there.
  [[nodiscard]] double RangeThrough(const Eigen::Vector3d& p) const {
    const auto at = Pixel(p);
    return at ? range_mm_(*at) / 1000.0 : 0;
  }
  [[nodiscard]] std::optional<cv::Point> Pixel(const Eigen::Vector3d& p) const {
    const auto pixel = panorama_.Pixel(p - panorama_.center);
    if (!pixel) return std::nullopt;
    return cv::Point(std::clamp(static_cast<int>(std::lround(pixel->x())), 0, panorama_.width - 1),
                     std::clamp(static_cast<int>(std::lround(pixel->y())), 0, panorama_.height - 1));
  }
  [[nodiscard]] Eigen::Vector3d End(int x, int y) const {
    return panorama_.center + range_mm_(y, x) / 1000.0 * panorama_.Ray(x, y);
  }
  // The surface at the end of the ray through p: a point of it and its normal, from ends a few pixels around.
  // Nothing at edges, where they are no plane.
  [[nodiscard]] bool SurfaceThrough(const Eigen::Vector3d& p, Eigen::Vector3d& on,
                                    Eigen::Vector3d& normal) const {
    constexpr int kAround = 6;  // px
    const auto at = Pixel(p);
    if (!at || at->x < kAround || at->y < kAround || at->x >= panorama_.width - kAround ||
        at->y >= panorama_.height - kAround)
      return false;
    const double range = range_mm_(*at) / 1000.0;
    for (const cv::Point d :
         {cv::Point(kAround, 0), cv::Point(-kAround, 0), cv::Point(0, kAround), cv::Point(0, -kAround)}) {
      const double other = range_mm_(*at + d) / 1000.0;
      if (range <= 0 || other <= 0 || std::abs(other - range) > 0.05 * range) return false;
    }
    on = End(at->x, at->y);
    const Eigen::Vector3d across = End(at->x + kAround, at->y) - End(at->x - kAround, at->y);
    const Eigen::Vector3d down = End(at->x, at->y + kAround) - End(at->x, at->y - kAround);
    normal = across.cross(down);
    if (normal.norm() < 1e-9) return false;
    normal.normalize();
    return true;
  }
  // p is where the scan saw a surface, or before it, where it saw that there is none.
  [[nodiscard]] bool Sees(const Eigen::Vector3d& p) const {
    const double range = RangeThrough(p);
    return range > 0 && (p - panorama_.center).norm() < range + kOnSurface_m + kOnSurfaceOfRange * range;
  }

 private:
  const Panorama& panorama_;
  const cv::Mat1w& range_mm_;
};

// Points of a scan's own picture, evenly over its directions.
std::vector<Eigen::Vector3d> PointsOf(const RoomScan& scan, std::size_t about) {
  const Sight sight(scan);
  const cv::Mat1w& range = scan.pictures.range_mm;
  const int step = std::max(
      1, static_cast<int>(std::sqrt(static_cast<double>(range.total()) / static_cast<double>(about))));
  std::vector<Eigen::Vector3d> points;
  for (int y = step / 2; y < range.rows; y += step)
    for (int x = step / 2; x < range.cols; x += step)
      if (range(y, x) > 0) points.push_back(sight.End(x, y));
  return points;
}

// Median of the light of the first over that of the second where both see one surface; 1 where too few do.
double GainBetween(const RoomScan& first, const RoomScan& second, const RigidTransform& T_first_second) {
  const Sight in_first(first), in_second(second);
  std::vector<double> ratios;
  for (const Eigen::Vector3d& q : PointsOf(second, 20'000)) {
    const Eigen::Vector3d p = T_first_second * q;
    const double range = in_first.RangeThrough(p), length = (p - in_first.center()).norm();
    if (range <= 0 || std::abs(range - length) > kOnSurface_m) continue;
    const cv::Vec4b a = first.pictures.color_bgra(*in_first.Pixel(p)),
                    b = second.pictures.color_bgra(*in_second.Pixel(q));
    if (a[3] == 0 || b[3] == 0 || std::min(a[1], b[1]) < 20 || std::max(a[1], b[1]) > 240) continue;
    ratios.push_back(static_cast<double>(a[1]) / b[1]);
  }
  if (ratios.size() < 100) return 1;
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  return std::clamp(*middle, 0.5, 2.0);
}

// Both textures one upon the other, made smaller until the sides fit; coordinates follow.
void Stack(const RoomModel& top, const RoomModel& bottom, RoomModel& out) {
  const int width = std::max(top.texture_bgr.cols, bottom.texture_bgr.cols);
  const int height = top.texture_bgr.rows + bottom.texture_bgr.rows;
  out.texture_bgr = cv::Mat3b(height, width, cv::Vec3b(0, 0, 0));
  top.texture_bgr.copyTo(out.texture_bgr(cv::Rect({0, 0}, top.texture_bgr.size())));
  bottom.texture_bgr.copyTo(out.texture_bgr(cv::Rect({0, top.texture_bgr.rows}, bottom.texture_bgr.size())));
  out.positions = top.positions;
  out.positions.insert(out.positions.end(), bottom.positions.begin(), bottom.positions.end());
  out.uvs.clear();
  auto place = [&](const RoomModel& model, int row) {
    for (const Eigen::Vector2f& uv : model.uvs)
      out.uvs.emplace_back(uv.x() * static_cast<float>(model.texture_bgr.cols) / static_cast<float>(width),
                           (static_cast<float>(row) + uv.y() * static_cast<float>(model.texture_bgr.rows)) /
                               static_cast<float>(height));
  };
  place(top, 0);
  place(bottom, top.texture_bgr.rows);
  out.indices = top.indices;
  for (const std::uint32_t i : bottom.indices)
    out.indices.push_back(i + static_cast<std::uint32_t>(top.positions.size()));
  const double scale = static_cast<double>(Panorama::kMostSide) / std::max(width, height);
  if (scale < 1) cv::resize(out.texture_bgr, out.texture_bgr, {}, scale, scale, cv::INTER_AREA);
}

// Keeps the triangles that are not wholly seen by the other scan. How many went.
std::size_t DropSeen(const Sight& other, const RigidTransform& T_other_model, RoomModel& model) {
  std::vector<std::uint8_t> seen(model.positions.size());
  for (std::size_t i = 0; i < seen.size(); ++i)
    seen[i] = other.Sees(T_other_model * model.positions[i].cast<double>());
  std::vector<std::uint32_t> kept;
  for (std::size_t t = 0; t + 2 < model.indices.size(); t += 3) {
    const auto* corner = &model.indices[t];
    if (!(seen[corner[0]] && seen[corner[1]] && seen[corner[2]])) kept.insert(kept.end(), corner, corner + 3);
  }
  const std::size_t dropped = (model.indices.size() - kept.size()) / 3;
  model.indices = std::move(kept);
  return dropped;
}

// The first's picture with what the second saw in its place. Ends of the second's rays are looked for along
// the first's.
void JoinPictures(const RoomScan& first, const RoomScan& second, const RigidTransform& T_first_second,
                  Join join, double gain, PanoramaPictures& out) {
  const Sight in_second(second);
  const RigidTransform T_second_first = T_first_second.inverse();
  const Panorama& panorama = first.environment.panorama;
  const Eigen::Vector3d from = T_second_first * panorama.center;
  out.color_bgra = first.pictures.color_bgra.clone();
  out.range_mm = first.pictures.range_mm.clone();
  cv::parallel_for_({0, panorama.height}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < panorama.width; ++x) {
        const double known = out.range_mm(y, x) / 1000.0;
        if (join == Join::kMerge && known > 0) continue;
        const Eigen::Vector3d ray = T_second_first.linear() * panorama.Ray(x, y);
        if (known > 0 && !in_second.Sees(from + known * ray)) continue;
        double length = known > 0 ? known : 3;
        bool met = false;
        for (int i = 0; i < 12 && !met; ++i) {
          const Eigen::Vector3d p = from + length * ray;
          const double end = in_second.RangeThrough(p), at = (p - in_second.center()).norm();
          if (end <= 0) break;
          met = std::abs(end - at) < 0.005;
          if (!met) length += end - at;
          if (!(length > 0.05 && length < 60)) break;
        }
        if (!met) continue;
        const cv::Vec4b color = second.pictures.color_bgra(*in_second.Pixel(from + length * ray));
        if (color[3] == 0) continue;
        out.range_mm(y, x) = cv::saturate_cast<std::uint16_t>(1000 * length);
        for (int c = 0; c < 3; ++c)
          out.color_bgra(y, x)[c] = cv::saturate_cast<std::uint8_t>(gain * color[c]);
        out.color_bgra(y, x)[3] = 255;
      }
    }
  });
}

}  // namespace

RigidTransform MeetRooms(const RoomScan& first, const RoomScan& second, JoinReport& report) {
  const Sight sight(first);
  const std::vector<Eigen::Vector3d> points = PointsOf(second, 20'000);
  RigidTransform T = RigidTransform::Identity();
  for (const double reach_m :
       {0.5, 0.5, 0.5, 0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.1, kOnSurface_m, kOnSurface_m, kOnSurface_m}) {
    Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> b = Eigen::Matrix<double, 6, 1>::Zero();
    std::size_t looked = 0, met = 0;
    double squares = 0;
    for (const Eigen::Vector3d& q : points) {
      const Eigen::Vector3d p = T * q;
      Eigen::Vector3d on, normal;
      if (!sight.SurfaceThrough(p, on, normal)) continue;
      ++looked;
      const double off = normal.dot(on - p);
      if (std::abs(off) > reach_m) continue;
      ++met;
      squares += off * off;
      Eigen::Matrix<double, 6, 1> row;  // turn about the first's centre, shift
      row << (p - sight.center()).cross(normal), normal;
      const double weight = 1 - off * off / (reach_m * reach_m);
      A += weight * weight * row * row.transpose();
      b += weight * weight * off * row;
    }
    report.met = looked == 0 ? 0 : static_cast<double>(met) / static_cast<double>(looked);
    report.apart_m = met == 0 ? 0 : std::sqrt(squares / static_cast<double>(met));
    if (met < 100) break;
    A.diagonal().array() += 1e-6 * static_cast<double>(met);  // what no surface determines stays
    const Eigen::Matrix<double, 6, 1> step = A.ldlt().solve(b);
    RigidTransform turn = RigidTransform::Identity();
    const Eigen::Vector3d w = step.head<3>();
    if (w.norm() > 1e-12) turn.linear() = Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix();
    turn.translation() = sight.center() - turn.linear() * sight.center() + step.tail<3>();
    T = turn * T;
  }
  const Eigen::Vector3d middle = second.environment.panorama.center;
  report.turn_deg = Eigen::AngleAxisd(T.linear()).angle() * kDegrees;
  report.shift_m = (T * middle - middle).norm();
  return T;
}

RoomScan JoinRooms(const RoomScan& first, const RoomScan& second, const RigidTransform& T_first_second,
                   Join join, JoinReport& report) {
  RoomScan out;
  report.gain = GainBetween(first, second, T_first_second);
  JoinPictures(first, second, T_first_second, join, report.gain, out.pictures);

  RoomModel base = first.room, other = second.room;
  SplitForPanorama(first.environment.panorama, base);
  SplitForPanorama(second.environment.panorama, other);
  if (join == Join::kPatch)
    report.dropped = DropSeen(Sight(second), T_first_second.inverse(), base);
  else
    DropSeen(Sight(first), T_first_second, other);
  report.added = other.triangle_count();
  for (Eigen::Vector3f& p : other.positions) p = (T_first_second * p.cast<double>()).cast<float>();
  other.texture_bgr.convertTo(other.texture_bgr, -1, report.gain);
  Stack(base, other, out.room);

  Environment& e = out.environment;
  e = first.environment;
  e.depth_sigma_m = std::max(e.depth_sigma_m, std::max(second.environment.depth_sigma_m, report.apart_m / 2));
  e.registration_px = std::max(e.registration_px, second.environment.registration_px);
  for (const SweepFrame& f : second.environment.frames)
    e.frames.push_back({"joined_" + f.name, T_first_second * f.T_world_color});
  for (RoomPlane plane : second.environment.planes) {
    plane.normal = T_first_second.linear() * plane.normal;
    plane.d -= plane.normal.dot(T_first_second.translation());
    for (Eigen::Vector3d& p : plane.polygon) p = T_first_second * p;
    constexpr double kSameTurn = 0.998;  // cosine of 3.6 degrees
    const bool known = std::any_of(
        first.environment.planes.begin(), first.environment.planes.end(), [&](const RoomPlane& old) {
          return old.normal.dot(plane.normal) > kSameTurn && std::abs(old.d - plane.d) < kOnSurface_m;
        });
    plane.name = "joined_" + plane.name;
    if (!known) e.planes.push_back(std::move(plane));
  }
  for (RoomLamp lamp : second.environment.lamps) {
    lamp.center = T_first_second * lamp.center;
    lamp.edge_u = T_first_second.linear() * lamp.edge_u;
    lamp.edge_v = T_first_second.linear() * lamp.edge_v;
    const bool known =
        std::any_of(first.environment.lamps.begin(), first.environment.lamps.end(), [&](const RoomLamp& old) {
          return (old.center - lamp.center).norm() < std::max(0.3, old.edge_u.norm() + old.edge_v.norm());
        });
    lamp.name = "joined_" + lamp.name;
    if (!known) e.lamps.push_back(std::move(lamp));
  }
  return out;
}

}  // namespace mixstage
