// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/room_regions.h"

#include <algorithm>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "proto/base/check.h"
#include "server/segmentation/enlarge.h"

namespace mixstage {
namespace {

// In front of the room, or of a region, by so many sigma.
constexpr float kInFront = 3.0f;
// Where the room's own noise is not known: a ToF camera's at z, times z squared.
constexpr float kSigmaPerMetre = 0.006f;
// Quarter-size pixels: depth's own outline is a band of about 8 full pixels, and late.
constexpr int kOutline = 3;
constexpr float kFarthest_m = 1e6f;

// The surface that a pixel shows.
struct Surface {
  float z_m = 0;  // 0 = not known
  float sigma_m = 0;
  bool before_room = false;
};

Surface SurfaceAt(const BackgroundModel& model, const cv::Mat1f& depth_m, int x, int y) {
  Surface surface;
  const float room = model.has_depth() ? model.room_depth_m(y, x) : 0.0f;
  const float z = depth_m.empty() ? 0.0f : depth_m(y, x);
  surface.sigma_m = room > 0 ? model.sigma_m(y, x) : kSigmaPerMetre * z * z;
  surface.before_room = room > 0 && z > 0 && room - z > kInFront * surface.sigma_m;
  surface.z_m = room > 0 && !surface.before_room ? room : z;
  return surface;
}

// 0 and 255 at a quarter of the size -> the same at half the size, its outline smooth.
void EnlargeMask(const cv::Mat1b& small, cv::Size half, cv::Mat1b* to) {
  to->create(half);
  EnlargeTwice(small, View(*to));
}

}  // namespace

RegionMask::RegionMask(const PinholeCamera& camera, RoomRegions regions)
    : camera_(camera), regions_(std::move(regions)) {
  MIX_CHECK(camera_.Validate().has_value());
  rays_.create(Quarter(camera_.height), Quarter(camera_.width));
  for (int y = 0; y < rays_.rows; ++y) {
    for (int x = 0; x < rays_.cols; ++x) {
      // Where QuarterDepth takes its samples.
      const auto ray = camera_.Unproject(
          Eigen::Vector2d(std::min(4 * x + 1, camera_.width - 1), std::min(4 * y + 1, camera_.height - 1)));
      rays_(y, x) = ray ? cv::Vec2f(static_cast<float>(ray->x()), static_cast<float>(ray->y()))
                        : cv::Vec2f::all(std::numeric_limits<float>::quiet_NaN());
    }
  }
}

// p = R (z ray) + t lies within a plane where z (n . R ray) + (n . t + d) >= 0: what is left of z > 0 after
// every plane.
void RegionMask::Project(const RigidTransform& T_region_color) {
  projected_.resize(regions_.regions.size());
  for (std::size_t i = 0; i < projected_.size(); ++i) {
    const RoomRegion& region = regions_.regions[i];
    Projected& projected = projected_[i];
    projected.kind = region.kind;
    projected.z_m.create(rays_.size());
    cv::Point first(rays_.cols, rays_.rows), last(-1, -1);
    std::vector<Eigen::Vector4f> planes;
    for (const Eigen::Vector4d& plane : region.planes) {
      const Eigen::Vector3d normal = T_region_color.linear().transpose() * plane.head<3>();
      const double d = plane.head<3>().dot(T_region_color.translation()) + plane.w();
      planes.emplace_back(Eigen::Vector4d(normal.x(), normal.y(), normal.z(), d).cast<float>());
    }
    for (int y = 0; y < rays_.rows; ++y) {
      for (int x = 0; x < rays_.cols; ++x) {
        const cv::Vec2f ray = rays_(y, x);
        float near = 0, far = ray[0] == ray[0] ? kFarthest_m : 0.0f;
        for (const Eigen::Vector4f& p : planes) {
          const float slope = p.x() * ray[0] + p.y() * ray[1] + p.z();
          if (slope > 0) {
            near = std::max(near, -p.w() / slope);
          } else if (slope < 0) {
            far = std::min(far, -p.w() / slope);
          } else if (p.w() < 0) {
            far = 0;
          }
        }
        projected.z_m(y, x) = cv::Vec2f(near, far);
        if (!(near < far)) continue;
        first = {std::min(first.x, x), std::min(first.y, y)};
        last = {std::max(last.x, x), std::max(last.y, y)};
      }
    }
    projected.box = last.x < 0 ? cv::Rect() : cv::Rect(first, cv::Point(last.x + 1, last.y + 1));
  }
}

void RegionMask::Run(const RigidTransform& T_world_color, const BackgroundModel& model,
                     ImageView<const float> depth_m) {
  MIX_CHECK(model.width == camera_.width && model.height == camera_.height);
  MIX_CHECK(depth_m.empty() || (depth_m.width() == model.width && depth_m.height() == model.height));
  const RigidTransform T_region_color =
      regions_.frame == RegionFrame::kCamera ? RigidTransform::Identity() : T_world_color;
  if (!T_region_color_ || T_region_color_->matrix() != T_region_color.matrix()) {
    T_region_color_ = T_region_color;
    Project(T_region_color);
  }
  if (depth_m.empty()) {
    depth_m_.release();
  } else {
    QuarterDepth(depth_m, &depth_m_);
  }
  for (cv::Mat1b* mask : {&garbage_small_, &things_small_, &held_small_}) {
    mask->create(rays_.size());
    mask->setTo(0);
  }
  for (Projected& region : projected_) {
    if (region.box.empty()) continue;
    if (region.kind == RegionKind::kGarbage) {
      Bar(region, model);
    } else {
      Keep(region, model);
    }
  }
  garbage_small_.setTo(0, things_small_);
  garbage_small_.setTo(0, held_small_);
  const cv::Size half(Half(model.width), Half(model.height));
  EnlargeMask(garbage_small_, half, &garbage_);
  EnlargeMask(things_small_, half, &things_);
  EnlargeMask(held_small_, half, &held_);
  garbage_full_.create(model.height, model.width);
  held_full_.create(model.height, model.width);
  EnlargeTwice(garbage_, View(garbage_full_));
  EnlargeTwice(held_, View(held_full_));
  for (cv::Mat1b* mask : {&garbage_, &things_, &held_})
    cv::threshold(*mask, *mask, 127, 255, cv::THRESH_BINARY);
}

void RegionMask::Bar(Projected& region, const BackgroundModel& model) {
  region.in_front.create(rays_.size());
  region.in_front.setTo(0);
  bool any = false;
  for (int y = region.box.y; y < region.box.br().y && !depth_m_.empty(); ++y) {
    for (int x = region.box.x; x < region.box.br().x; ++x) {
      const Surface surface = SurfaceAt(model, depth_m_, x, y);
      const cv::Vec2f z = region.z_m(y, x);
      if (z[0] < z[1] && surface.z_m > 0 && surface.z_m < z[0] - kInFront * surface.sigma_m &&
          (surface.before_room || !model.has_depth() || model.room_depth_m(y, x) <= 0)) {
        region.in_front(y, x) = 255;
        any = true;
      }
    }
  }
  if (any) {
    cv::Mat part = region.in_front(region.box);
    cv::dilate(part, part, cv::getStructuringElement(cv::MORPH_RECT, {2 * kOutline + 1, 2 * kOutline + 1}));
  }
  for (int y = region.box.y; y < region.box.br().y; ++y) {
    for (int x = region.box.x; x < region.box.br().x; ++x) {
      const cv::Vec2f z = region.z_m(y, x);
      if (!(z[0] < z[1]) || region.in_front(y, x) != 0) continue;
      const Surface surface = SurfaceAt(model, depth_m_, x, y);
      if (surface.z_m > 0 && (surface.z_m < z[0] - surface.sigma_m || surface.z_m > z[1] + surface.sigma_m))
        continue;
      garbage_small_(y, x) = 255;
    }
  }
}

void RegionMask::Keep(Projected& region, const BackgroundModel& model) {
  for (int y = region.box.y; y < region.box.br().y; ++y) {
    for (int x = region.box.x; x < region.box.br().x; ++x) {
      const cv::Vec2f z = region.z_m(y, x);
      if (!(z[0] < z[1])) continue;
      const Surface surface = SurfaceAt(model, depth_m_, x, y);
      if (surface.before_room && surface.z_m >= z[0] && surface.z_m <= z[1]) things_small_(y, x) = 255;
      const float room = model.has_depth() ? model.room_depth_m(y, x) : 0.0f;
      const float own = room > 0 ? room : surface.z_m;
      if (own <= 0 || (own >= z[0] && own <= z[1])) held_small_(y, x) = 255;
    }
  }
}

void RegionMask::Lay(ImageView<std::uint8_t> alpha, cv::Mat1b* half_mask) const {
  MIX_CHECK(alpha.width() == garbage_full_.cols && alpha.height() == garbage_full_.rows);
  MIX_CHECK(half_mask->size() == garbage_.size());
  half_mask->setTo(0, garbage_);
  for (int y = 0; y < alpha.height(); ++y) {
    const std::uint8_t* garbage = garbage_full_.ptr<std::uint8_t>(y);
    const std::uint8_t* held = held_full_.ptr<std::uint8_t>(y);
    std::uint8_t* out = alpha.row(y);
    for (int x = 0; x < alpha.width(); ++x) {
      const std::uint8_t left = garbage[x] > 127 ? std::uint8_t{0} : out[x];
      out[x] = held[x] > 127 ? std::uint8_t{255} : left;
    }
  }
}

void RegionMask::LayDepth(const BackgroundModel& model, cv::Mat1f* surface_m) const {
  MIX_CHECK(surface_m->size() == held_.size());
  if (!model.has_depth()) return;
  for (int y = 0; y < surface_m->rows; ++y) {
    const std::uint8_t* held = held_.ptr<std::uint8_t>(y);
    float* z = surface_m->ptr<float>(y);
    const float* room = model.room_depth_m.ptr<float>(y / 2);
    for (int x = 0; x < surface_m->cols; ++x) {
      if (held[x] != 0 && z[x] <= 0) z[x] = room[x / 2];
    }
  }
}

}  // namespace mixstage
