// SPDX-License-Identifier: Apache-2.0
#include "server/render/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr float kHalf = 0.5f * ShadowRasteriser::kFacePx;
constexpr float kCenter = kHalf - 0.5f;
// A directional light stands so many radii of what it shines on away.
constexpr float kSunDistance = 200;
constexpr float kNothing_m = 1e9f;

// The faces of the rasteriser's camera look over 90 degrees; other focal lengths are reached by scaling x
// and y.
PinholeCamera FaceCamera() {
  PinholeCamera camera;
  camera.width = camera.height = ShadowRasteriser::kFacePx;
  camera.fx = camera.fy = static_cast<double>(kHalf);
  camera.cx = camera.cy = static_cast<double>(kCenter);
  return camera;
}

// Face 2 a + s looks along the scene's axis a, to the negative side for s = 1.
Eigen::Matrix3f FaceRotation(std::size_t number) {
  const auto axis = static_cast<Eigen::Index>(number / 2);
  const float sign = number % 2 == 0 ? 1.0f : -1.0f;
  Eigen::Matrix3f R = Eigen::Matrix3f::Zero();
  R(0, (axis + 1) % 3) = 1;
  R(1, (axis + 2) % 3) = sign;
  R(2, axis) = sign;
  return R;
}

std::size_t FaceOf(const Eigen::Vector3f& d) {
  const float x = std::abs(d.x()), y = std::abs(d.y()), z = std::abs(d.z());
  if (z >= x && z >= y) return d.z() < 0 ? 5 : 4;
  if (y >= x) return d.y() < 0 ? 3 : 2;
  return d.x() < 0 ? 1 : 0;
}

// Whether a sphere reaches into the face's pyramid of 90 degrees.
bool Reaches(const Eigen::Vector3f& center_face, float radius) {
  const float margin = radius * std::numbers::sqrt2_v<float>;
  return center_face.z() + radius > 0 && std::abs(center_face.x()) <= center_face.z() + margin &&
         std::abs(center_face.y()) <= center_face.z() + margin;
}

}  // namespace

ShadowRasteriser::ShadowRasteriser() {
  auto rasteriser = CreateRasteriser(RasterBackend::kCpu, FaceCamera(), {kNear_m});
  MIX_CHECK(rasteriser.has_value());
  rasteriser_ = std::move(*rasteriser);
}

void ShadowMap::Clear() {
  for (Face& face : faces_) face.in_use = false;
  faces_in_use_ = 0;
}

void ShadowMap::Draw(const LampSample& lamp, std::span<const ShadowCaster> casters,
                     ShadowRasteriser& rasteriser) {
  Clear();
  if (casters.empty()) return;
  directional_ = lamp.kind == LampSample::Kind::kDirectional;
  if (directional_) {
    Eigen::AlignedBox3f box;
    for (const ShadowCaster& caster : casters) {
      box.extend(caster.center + Eigen::Vector3f::Constant(caster.radius_m));
      box.extend(caster.center - Eigen::Vector3f::Constant(caster.radius_m));
    }
    const float radius = std::max(0.01f, 0.5f * box.diagonal().norm());
    position_ = box.center() + kSunDistance * radius * lamp.vector;
    Eigen::Matrix3f R;
    R.row(2) = -lamp.vector.transpose();
    R.row(0) = lamp.vector.unitOrthogonal().transpose();
    R.row(1) = lamp.vector.cross(lamp.vector.unitOrthogonal()).transpose();
    DrawFace(0, R, kHalf * 0.98f * (kSunDistance - 1), casters, rasteriser);
    return;
  }
  position_ = lamp.vector;
  for (std::size_t number = 0; number < faces_.size(); ++number)
    DrawFace(number, FaceRotation(number), kHalf, casters, rasteriser);
}

void ShadowMap::DrawFace(std::size_t number, const Eigen::Matrix3f& R_face_scene, float focal_px,
                         std::span<const ShadowCaster> casters, ShadowRasteriser& rasteriser) {
  Eigen::Affine3d T_face_scene = Eigen::Affine3d::Identity();
  T_face_scene.linear() = R_face_scene.cast<double>();
  T_face_scene.translation() = -(R_face_scene * position_).cast<double>();
  const double stretch = static_cast<double>(focal_px / kHalf);
  T_face_scene = Eigen::Scaling(stretch, stretch, 1.0) * T_face_scene;
  bool begun = false;
  for (const ShadowCaster& caster : casters) {
    if (!directional_ && !Reaches(R_face_scene * (caster.center - position_), caster.radius_m)) continue;
    if (!begun) (*rasteriser).Begin({});
    begun = true;
    (*rasteriser).DrawDepth(caster.mesh, T_face_scene * caster.T_scene_mesh, Faces::kBoth);
  }
  if (!begun) return;
  const VisibilityBuffer& seen = (*rasteriser).Finish();
  if (seen.touched.empty()) return;
  Face& face = faces_[number];
  face.in_use = true;
  ++faces_in_use_;
  face.R_face_scene = R_face_scene;
  face.focal_px = focal_px;
  const cv::Rect& touched = seen.touched;
  face.box = {touched.x - 1, touched.y - 1, touched.width + 2, touched.height + 2};
  face.depth_m.create(face.box.size());
  face.depth_m.setTo(kNothing_m);
  face.nearest_m = kNothing_m;
  for (int y = 0; y < touched.height; ++y) {
    const float* from = seen.depth_m[touched.y + y] + touched.x;
    float* to = face.depth_m[y + 1] + 1;
    for (int x = 0; x < touched.width; ++x) {
      to[x] = from[x] > 0 ? from[x] : kNothing_m;
      face.nearest_m = std::min(face.nearest_m, to[x]);
    }
  }
}

bool ShadowMap::MayHide(const Eigen::Vector3f& center, float radius_m) const {
  if (faces_in_use_ == 0) return false;
  const Eigen::Vector3f d = center - position_;
  const Eigen::Vector3f a = d.cwiseAbs();
  const std::size_t number = directional_ ? 0 : FaceOf(d);
  const float ahead = a.maxCoeff();
  // Second largest of the three: beside it the next face begins.
  const float beside = a.sum() - ahead - a.minCoeff();
  if (!directional_ && ahead - beside < 2 * radius_m) return true;
  const Face& face = faces_[number];
  if (!face.in_use) return false;
  const Eigen::Vector3f q = face.R_face_scene * d;
  if (!(q.z() > 2 * radius_m)) return true;
  if (q.z() + radius_m < face.nearest_m) return false;
  const float scale = face.focal_px / q.z();
  // Off the axis a sphere looks longer, by sqrt 3 at most, and nearer than its middle.
  const float reach = 2 * face.focal_px * radius_m / (q.z() - radius_m) + 1;
  const float x = scale * q.x() + kCenter - static_cast<float>(face.box.x);
  const float y = scale * q.y() + kCenter - static_cast<float>(face.box.y);
  return x + reach > 0 && y + reach > 0 && x - reach < static_cast<float>(face.box.width) &&
         y - reach < static_cast<float>(face.box.height);
}

void ShadowMap::Lit(const PointRun& points, float bias_m, LitRun& lit) const {
  lit.fill(1);
  for (std::size_t number = 0; number < faces_.size(); ++number) {
    const Face& face = faces_[number];
    if (!face.in_use) continue;
    ShadowFaceView view;
    view.number = directional_ ? -1 : static_cast<int>(number);
    Eigen::Vector3f::Map(view.position.data()) = position_;
    Eigen::Matrix<float, 3, 3, Eigen::RowMajor>::Map(view.R_face_scene.data()) = face.R_face_scene;
    view.focal_px = face.focal_px;
    view.center_px = {kCenter - static_cast<float>(face.box.x), kCenter - static_cast<float>(face.box.y)};
    view.width = face.box.width;
    view.height = face.box.height;
    view.stride = static_cast<int>(face.depth_m.step1());
    view.depth_m = face.depth_m[0];
    LookUpShadow(view, points, bias_m, lit);
  }
}

}  // namespace mixstage
