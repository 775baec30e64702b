// SPDX-License-Identifier: Apache-2.0
#include "server/render/room_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/base/check.h"
#include "server/render/interpolate.h"
#include "server/render/srgb.h"

namespace mixstage {
namespace {

constexpr double kNearestRoom_m = 0.5;  // for how far a step of the camera moves a pixel
// Samples of a half-size pixel lie on one surface while their depths are so close: then one look at its
// middle serves.
constexpr float kOneSurface = 1.03f;
// A sample between texels already reaches over two of them: at the pixel's own size it would blur twice.
constexpr float kSharper = 0.7f;
// Gaps up to this share of the picture's width are thin: cells torn at a silhouette, strips that its parallax
// hid.
constexpr int kThinShare = 40;

PinholeCamera HalfOf(const PinholeCamera& camera) {
  PinholeCamera half = camera;
  half.width = (camera.width + 1) / 2;
  half.height = (camera.height + 1) / 2;
  half.fx = 0.5 * camera.fx;
  half.fy = 0.5 * camera.fy;
  half.cx = 0.5 * (camera.cx + 0.5) - 0.5;
  half.cy = 0.5 * (camera.cy + 0.5) - 0.5;
  return half;
}

Texture TextureOf(const cv::Mat3b& bgr) {
  Texture texture;
  texture.wrap_u = texture.wrap_v = TextureWrap::kClamp;
  texture.rgba.create(bgr.size());
  for (int y = 0; y < bgr.rows; ++y) {
    for (int x = 0; x < bgr.cols; ++x) {
      const cv::Vec3b& p = bgr(y, x);
      texture.rgba(y, x) = {p[2], p[1], p[0], 255};
    }
  }
  return texture;
}

// Pixels that the picture moves by between two poses, at the most.
double Moved_px(const RigidTransform& a, const RigidTransform& b, double focal_px) {
  const RigidTransform step = a.inverse() * b;
  const double angle_rad = Eigen::AngleAxisd(step.linear()).angle();
  return focal_px * (angle_rad + step.translation().norm() / kNearestRoom_m);
}

// Where a thin gap between surfaces is continued from: the pixel at the end of the shorter run, across or
// down, that lies farther away (beside a silhouette stands the room behind it). Indices into depth_m, -1
// elsewhere.
cv::Mat1i FindSources(const cv::Mat1f& depth_m, int widest) {
  cv::Mat1i source(depth_m.size(), -1);
  cv::Mat1i length(depth_m.size(), widest + 1);
  const int width = depth_m.cols;
  // A line of the picture: its n pixels lie `step` apart.
  auto fill_line = [&](int first, int step, int n) {
    const float* z = depth_m.ptr<float>() + first;
    for (int i = 0; i < n;) {
      if (z[i * step] > 0) {
        ++i;
        continue;
      }
      const int begin = i;
      while (i < n && !(z[i * step] > 0)) ++i;
      const int run = i - begin;
      if (run > widest || run == n) continue;
      const bool before = begin > 0 && (i == n || z[(begin - 1) * step] >= z[i * step]);
      const int from = first + (before ? begin - 1 : i) * step;
      for (int k = begin; k < i; ++k) {
        const int at = first + k * step;
        if (run >= length(at)) continue;
        length(at) = run;
        source(at) = from;
      }
    }
  };
  for (int y = 0; y < depth_m.rows; ++y) fill_line(y * width, 1, width);
  for (int x = 0; x < width; ++x) fill_line(x, width, depth_m.rows);
  return source;
}

}  // namespace

RoomView::RoomView(const Rig& rig, RoomModel room, std::unique_ptr<Rasteriser> rasteriser)
    : color_(rig.color),
      positions_(std::move(room.positions)),
      uvs_(std::move(room.uvs)),
      indices_(std::move(room.indices)),
      texture_(TextureOf(room.texture_bgr)),
      rasteriser_(std::move(rasteriser)),
      full_(ShadingOf(rig, rig.color)),
      half_(ShadingOf(rig, HalfOf(rig.color))) {
  corners_.resize(positions_.size());
}

Result<RoomView> RoomView::Create(const Rig& rig, RoomModel room, const RenderDevice& device) {
  MIX_CHECK(room.Validate().has_value());
  auto rasteriser = CreateRasteriser(device.backend, rig.color, {}, device.gpu);
  if (!rasteriser) return tl::unexpected(rasteriser.error());
  return RoomView(rig, std::move(room), std::move(*rasteriser));
}

RoomView::Shading RoomView::ShadingOf(const Rig& rig, const PinholeCamera& camera) {
  Shading shading;
  shading.rays = UnprojectionTable(camera);
  shading.pixel_rad = static_cast<float>(1 / std::sqrt(camera.fx * camera.fy));
  shading.gain.create(camera.height, camera.width);
  const double half_diagonal = 0.5 * std::hypot(camera.width, camera.height);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double r2 =
          (std::pow(u - camera.cx, 2) + std::pow(v - camera.cy, 2)) / (half_diagonal * half_diagonal);
      shading.gain(v, u) =
          static_cast<float>(std::max(0.0, 1 + r2 * (rig.vignetting_a + r2 * rig.vignetting_b)));
    }
  }
  return shading;
}

const RoomPrediction& RoomView::Look(const RigidTransform& T_world_color) {
  if (prediction_.drawing == 0 ||
      Moved_px(T_world_color_, T_world_color, std::max(color_.fx, color_.fy)) > kRest_px) {
    Redraw(T_world_color);
  }
  return prediction_;
}

void RoomView::Redraw(const RigidTransform& T_world_color) {
  T_world_color_ = T_world_color;
  const RigidTransform T_color_world = T_world_color.inverse();
  rasteriser_->Begin({});
  rasteriser_->Draw({.positions = positions_, .indices = indices_}, Eigen::Affine3d(T_color_world.matrix()),
                    0, Faces::kBoth);
  visible_ = &rasteriser_->Finish();

  const Eigen::Matrix3f R = T_color_world.linear().cast<float>();
  const Eigen::Vector3f t = T_color_world.translation().cast<float>();
  for (std::size_t i = 0; i < positions_.size(); ++i) {
    const Eigen::Vector3f p = R * positions_[i] + t;
    corners_[i] = Eigen::Array4f(p.x(), p.y(), p.z(), uvs_[i].x());
  }

  const std::uint64_t drawing = prediction_.drawing + 1;
  const cv::Size half = half_.rays.size();
  prediction_ = {.drawing = drawing,
                 .width = color_.width,
                 .height = color_.height,
                 .r = cv::Mat1b(half),
                 .g = cv::Mat1b(half),
                 .b = cv::Mat1b(half),
                 .seen = cv::Mat1b(half),
                 .depth_m = visible_->depth_m.clone()};
  const SrgbTables& srgb = SrgbTables::Get();
  cv::Mat1f half_depth(half);
  for (int v = 0; v < half.height; ++v) {
    CollectHalf(v);
    Shade(half_, v, row_);
    for (int u = 0; u < half.width; ++u) {
      const cv::Vec4f& p = row_[static_cast<std::size_t>(u)];
      // A pixel half of which was never observed is no picture of the room.
      const bool seen = p[3] > 0.5f;
      const float scale = seen ? half_.gain(v, u) / p[3] : 0.0f;
      prediction_.r(v, u) = srgb.ToSrgb(scale * p[0]);
      prediction_.g(v, u) = srgb.ToSrgb(scale * p[1]);
      prediction_.b(v, u) = srgb.ToSrgb(scale * p[2]);
      prediction_.seen(v, u) = seen ? RoomPrediction::kSeen : std::uint8_t{0};
      half_depth(v, u) = seen ? DepthAround(u, v) : 0.0f;
    }
  }
  FillThinGaps(half_depth);
}

// The farthest of a half-size pixel's samples.
float RoomView::DepthAround(int u, int v) const {
  const cv::Mat1f& z = visible_->depth_m;
  const int right = std::min(2 * u + 1, color_.width - 1);
  const int below = std::min(2 * v + 1, color_.height - 1);
  return std::max({z(2 * v, 2 * u), z(2 * v, right), z(below, 2 * u), z(below, right)});
}

void RoomView::FillThinGaps(const cv::Mat1f& half_depth_m) {
  const int widest = std::max(2, color_.width / kThinShare);
  if (cv::countNonZero(prediction_.depth_m) < color_.width * color_.height) {
    const cv::Mat1i source = FindSources(prediction_.depth_m, widest);
    for (int i = 0; i < color_.width * color_.height; ++i) {
      if (source(i) >= 0) prediction_.depth_m(i) = prediction_.depth_m(source(i));
    }
  }
  const cv::Mat1i source = FindSources(half_depth_m, widest / 2);
  for (int i = 0; i < static_cast<int>(source.total()); ++i) {
    if (source(i) < 0) continue;
    for (cv::Mat1b* channel : {&prediction_.r, &prediction_.g, &prediction_.b})
      (*channel)(i) = (*channel)(source(i));
    prediction_.seen(i) = RoomPrediction::kFilled;
  }
}

cv::Mat3b RoomView::Picture() {
  MIX_CHECK(visible_ != nullptr);
  cv::Mat3b picture(color_.height, color_.width);
  const SrgbTables& srgb = SrgbTables::Get();
  for (int v = 0; v < picture.rows; ++v) {
    CollectFull(v);
    Shade(full_, v, row_);
    for (int u = 0; u < picture.cols; ++u) {
      const cv::Vec4f p = full_.gain(v, u) * row_[static_cast<std::size_t>(u)];
      picture(v, u) = {srgb.ToSrgb(p[2]), srgb.ToSrgb(p[1]), srgb.ToSrgb(p[0])};
    }
  }
  return picture;
}

void RoomView::CollectFull(int v) {
  fragments_.clear();
  const std::int32_t* triangles = visible_->triangle.ptr<std::int32_t>(v);
  const auto* rays = full_.rays.ptr<cv::Vec2f>(v);
  for (int u = 0; u < color_.width; ++u) {
    if (triangles[u] >= 0 && rays[u][0] == rays[u][0])
      fragments_.push_back({triangles[u], u, rays[u][0], rays[u][1], 1.0f});
  }
}

void RoomView::CollectHalf(int v) {
  fragments_.clear();
  const int above = 2 * v;
  const int below = std::min(2 * v + 1, color_.height - 1);
  const auto* rays = half_.rays.ptr<cv::Vec2f>(v);
  for (int u = 0; u < half_.rays.cols; ++u) {
    const int left = 2 * u;
    const int right = std::min(2 * u + 1, color_.width - 1);
    const cv::Point samples[4] = {{left, above}, {right, above}, {left, below}, {right, below}};
    float nearest = 1e30f;
    float farthest = 0;
    int known = 0;
    for (const cv::Point& p : samples) {
      const float z = visible_->depth_m(p);
      if (z == 0) continue;
      ++known;
      nearest = std::min(nearest, z);
      farthest = std::max(farthest, z);
    }
    if (known == 0) continue;
    const bool has_ray = rays[u][0] == rays[u][0];  // NaN beyond the lens's fold
    if (known == 4 && has_ray && farthest < kOneSurface * nearest) {
      fragments_.push_back({visible_->triangle(samples[0]), u, rays[u][0], rays[u][1], 1.0f});
      continue;
    }
    for (const cv::Point& p : samples) {
      const std::int32_t triangle = visible_->triangle(p);
      if (triangle < 0) continue;
      const cv::Vec2f& ray = full_.rays(p);
      if (ray[0] != ray[0]) continue;
      fragments_.push_back({triangle, u, ray[0], ray[1], 0.25f});
    }
  }
}

void RoomView::Shade(const Shading& shading, int v, std::vector<cv::Vec4f>& row) {
  MIX_CHECK(v < shading.rays.rows);
  row.assign(static_cast<std::size_t>(shading.rays.cols), cv::Vec4f::all(0));
  const std::size_t count = fragments_.size();
  if (count == 0) return;
  using enum FragmentRows::Row;
  if (count > rows_.capacity()) {
    rows_.Resize(count);
    rgba_.resize(4 * (rows_.capacity() + FragmentRows::kPadding));
    const auto all = static_cast<std::ptrdiff_t>(rows_.capacity());
    std::fill_n(rows_.row(kTextureWidth), all, static_cast<float>(texture_.levels()[0].width));
    std::fill_n(rows_.row(kTextureHeight), all, static_cast<float>(texture_.levels()[0].height));
    std::fill_n(rows_.row(kFront), all, 1.0f);
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Fragment& fragment = fragments_[i];
    rows_.row(kRayX)[i] = fragment.ray_x;
    rows_.row(kRayY)[i] = fragment.ray_y;
    const std::uint32_t* triangle = &indices_[3 * static_cast<std::size_t>(fragment.triangle)];
    for (std::size_t k = 0; k < 3; ++k) {
      Eigen::Map<Eigen::Array4f>(rows_.corner(k) + 4 * i) = corners_[triangle[k]];
      rows_.corner(k + 3)[4 * i + 3] = uvs_[triangle[k]].y();  // no normals: nothing is lit here
    }
  }
  Interpolate(shading.pixel_rad, count, rows_);
  float* texels = rows_.row(kTexelsPerTap);
  for (std::size_t i = 0; i < count; ++i) texels[i] *= kSharper;
  textures_.assign(count, &texture_);
  SampleTextures(textures_, rows_, rgba_.data());
  for (std::size_t i = 0; i < count; ++i) {
    const Fragment& fragment = fragments_[i];
    const float* p = &rgba_[4 * i];
    row[static_cast<std::size_t>(fragment.column)] += fragment.share * cv::Vec4f(p[0], p[1], p[2], 1.0f);
  }
}

}  // namespace mixstage
