// SPDX-License-Identifier: Apache-2.0
#include "server/render/room_view.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/srgb.h"
#include "proto/geometry/half_camera.h"
#include "server/render/interpolate.h"

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
constexpr std::size_t kChunkTriangles = 2000;
constexpr int kLargestTexture = 8192;  // px a side: the whole room at a camera's resolution

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

// Pixels of a thin gap between surfaces, and where they are continued from: the pixel at the end of the
// shorter run, across or down, that lies farther away (beside a silhouette stands the room behind it).
struct Continued {
  int pixel, source;  // indices into depth_m
};
void FindThinGaps(const cv::Mat1f& depth_m, int widest, std::vector<Continued>& gaps) {
  gaps.clear();
  const int width = depth_m.cols;
  const int height = depth_m.rows;
  const float* z = depth_m.ptr<float>();
  auto farther = [&](int before, int after) {
    if (before < 0 || after < 0) return std::max(before, after);
    return z[before] >= z[after] ? before : after;
  };
  for (int y = 0; y < height; ++y) {
    const float* row = z + y * width;
    for (int x = 0; x < width;) {
      if (row[x] > 0) {
        ++x;
        continue;
      }
      const int begin = x;
      while (x < width && !(row[x] > 0)) ++x;
      const int across = x - begin;
      const int beside = farther(begin > 0 ? y * width + begin - 1 : -1, x < width ? y * width + x : -1);
      for (int u = begin; u < x; ++u) {
        int above = y - 1;
        int below = y + 1;
        while (above >= 0 && y - above <= widest && !(z[above * width + u] > 0)) --above;
        while (below < height && below - above <= widest && !(z[below * width + u] > 0)) ++below;
        const int down = below - above - 1;
        const bool ends =
            (above < 0 || z[above * width + u] > 0) && (below == height || z[below * width + u] > 0);
        if (ends && down <= widest && down < across && (above >= 0 || below < height)) {
          gaps.push_back({y * width + u, farther(above >= 0 ? above * width + u : -1,
                                                 below < height ? below * width + u : -1)});
        } else if (across <= widest && beside >= 0) {
          gaps.push_back({y * width + u, beside});
        }
      }
    }
  }
}

// A picture whose old content somebody else may still hold.
template <typename T>
void CreateUnshared(cv::Size size, cv::Mat_<T>& picture) {
  if (picture.size() == size && picture.u != nullptr && picture.u->refcount == 1) return;
  picture = cv::Mat_<T>(size);
}

}  // namespace

RoomView::RoomView(const Rig& rig, std::shared_ptr<const Room> room, std::unique_ptr<Rasteriser> rasteriser)
    : color_(rig.color),
      room_(std::move(room)),
      rasteriser_(std::move(rasteriser)),
      full_(ShadingOf(rig, rig.color)),
      half_(ShadingOf(rig, HalfCamera(rig.color))) {
  for (const cv::Vec2f& ray : full_.rays) {
    const double angle = std::atan(std::hypot(ray[0], ray[1]));
    // Beyond the lens's fold a pixel has no ray: then nothing is left out.
    view_angle_rad_ = std::isfinite(angle) ? std::max(view_angle_rad_, angle) : std::numbers::pi;
    if (view_angle_rad_ == std::numbers::pi) break;
  }
  corners_.resize(room_->positions.size());
}

// Halves the triangles across their longest extent until a part has kChunkTriangles: near each other in the
// room, they are seen or not seen together.
RoomView::Room::Room(const RoomModel& room) : texture(TextureOf(room.texture_bgr), kLargestTexture) {
  const std::size_t count = room.triangle_count();
  std::vector<Eigen::Vector3f> middles(count);
  std::vector<std::uint32_t> order(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t* corner = &room.indices[3 * i];
    middles[i] = (room.positions[corner[0]] + room.positions[corner[1]] + room.positions[corner[2]]) / 3.0f;
    order[i] = static_cast<std::uint32_t>(i);
  }
  std::vector<std::pair<std::size_t, std::size_t>> open = {{0, count}};
  std::vector<std::uint32_t> number(room.positions.size());  // of a vertex in the chunk, from 1 on
  while (!open.empty()) {
    const auto [begin, end] = open.back();
    open.pop_back();
    Eigen::AlignedBox3f box;
    for (std::size_t i = begin; i < end; ++i) box.extend(middles[order[i]]);
    if (end - begin > kChunkTriangles) {
      Eigen::Index axis = 0;
      box.sizes().maxCoeff(&axis);
      const std::size_t middle = begin + (end - begin) / 2;
      const auto at = [&](std::size_t i) { return order.begin() + static_cast<std::ptrdiff_t>(i); };
      std::nth_element(at(begin), at(middle), at(end), [&](std::uint32_t a, std::uint32_t b) {
        return std::pair(middles[a][axis], a) < std::pair(middles[b][axis], b);
      });
      open.emplace_back(middle, end);
      open.emplace_back(begin, middle);
      continue;
    }
    Chunk chunk;
    chunk.first_vertex = static_cast<std::uint32_t>(positions.size());
    chunk.first_index = static_cast<std::uint32_t>(indices.size());
    chunk.triangles = static_cast<std::uint32_t>(end - begin);
    std::fill(number.begin(), number.end(), 0);
    Eigen::AlignedBox3f around;
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t vertex = room.indices[3 * order[i] + k];
        if (number[vertex] == 0) {
          positions.push_back(room.positions[vertex]);
          uvs.push_back(room.uvs[vertex]);
          around.extend(room.positions[vertex]);
          number[vertex] = ++chunk.vertices;
        }
        indices.push_back(number[vertex] - 1);
      }
      chunk_of.push_back(static_cast<std::uint32_t>(chunks.size()));
    }
    chunk.center = around.center().cast<double>();
    chunk.radius_m = 0.5 * static_cast<double>(around.diagonal().norm());
    chunks.push_back(chunk);
  }
}

bool RoomView::MaySee(const Chunk& chunk, const RigidTransform& T_color_world) const {
  const Eigen::Vector3d center = T_color_world * chunk.center;
  const double distance = center.norm();
  if (distance <= chunk.radius_m) return true;
  const double angle = std::atan2(std::hypot(center.x(), center.y()), center.z());
  return angle <= view_angle_rad_ + std::asin(chunk.radius_m / distance);
}

Result<RoomView> RoomView::Create(const Rig& rig, const RoomModel& room, const RenderDevice& device) {
  MIX_CHECK(room.Validate().has_value());
  return Of(rig, std::make_shared<const Room>(room), device);
}

Result<RoomView> RoomView::Beside(const Rig& rig, const RenderDevice& device) const {
  return Of(rig, room_, device);
}

Result<RoomView> RoomView::Of(const Rig& rig, std::shared_ptr<const Room> room, const RenderDevice& device) {
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
  const Eigen::Matrix3f R = T_color_world.linear().cast<float>();
  const Eigen::Vector3f t = T_color_world.translation().cast<float>();
  rasteriser_->Begin({});
  for (const Chunk& chunk : room_->chunks) {
    if (!MaySee(chunk, T_color_world)) continue;
    rasteriser_->Draw(
        {.positions = std::span(room_->positions).subspan(chunk.first_vertex, chunk.vertices),
         .indices = std::span(room_->indices).subspan(chunk.first_index, 3 * std::size_t{chunk.triangles})},
        Eigen::Affine3d(T_color_world.matrix()), static_cast<int>(chunk.first_index / 3), Faces::kBoth);
    for (std::size_t i = chunk.first_vertex; i < chunk.first_vertex + chunk.vertices; ++i) {
      const Eigen::Vector3f p = R * room_->positions[i] + t;
      corners_[i] = Eigen::Array4f(p.x(), p.y(), p.z(), room_->uvs[i].x());
    }
  }
  visible_ = &rasteriser_->Finish();

  const std::uint64_t drawing = prediction_.drawing + 1;
  const cv::Size half = half_.rays.size();
  std::swap(prediction_, before_);
  prediction_.drawing = drawing;
  prediction_.width = color_.width;
  prediction_.height = color_.height;
  for (cv::Mat1b* plane : {&prediction_.r, &prediction_.g, &prediction_.b, &prediction_.seen})
    CreateUnshared(half, *plane);
  CreateUnshared(full_.rays.size(), prediction_.depth_m);
  visible_->depth_m.copyTo(prediction_.depth_m);
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
  std::vector<Continued> gaps;
  FindThinGaps(prediction_.depth_m, widest, gaps);
  for (const Continued& gap : gaps) prediction_.depth_m(gap.pixel) = prediction_.depth_m(gap.source);
  FindThinGaps(half_depth_m, widest / 2, gaps);
  for (const Continued& gap : gaps) {
    for (cv::Mat1b* channel : {&prediction_.r, &prediction_.g, &prediction_.b})
      (*channel)(gap.pixel) = (*channel)(gap.source);
    prediction_.seen(gap.pixel) = RoomPrediction::kFilled;
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
    std::fill_n(rows_.row(kTextureWidth), all, static_cast<float>(room_->texture.levels()[0].width));
    std::fill_n(rows_.row(kTextureHeight), all, static_cast<float>(room_->texture.levels()[0].height));
    std::fill_n(rows_.row(kFront), all, 1.0f);
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Fragment& fragment = fragments_[i];
    rows_.row(kRayX)[i] = fragment.ray_x;
    rows_.row(kRayY)[i] = fragment.ray_y;
    const auto number = static_cast<std::size_t>(fragment.triangle);
    const std::uint32_t* triangle = &room_->indices[3 * number];
    const std::size_t first = room_->chunks[room_->chunk_of[number]].first_vertex;
    for (std::size_t k = 0; k < 3; ++k) {
      Eigen::Map<Eigen::Array4f>(rows_.corner(k) + 4 * i) = corners_[first + triangle[k]];
      rows_.corner(k + 3)[4 * i + 3] =
          room_->uvs[first + triangle[k]].y();  // no normals: nothing is lit here
    }
  }
  Interpolate(shading.pixel_rad, count, rows_);
  float* texels = rows_.row(kTexelsPerTap);
  for (std::size_t i = 0; i < count; ++i) texels[i] *= kSharper;
  textures_.assign(count, &room_->texture);
  SampleTextures(textures_, rows_, rgba_.data());
  for (std::size_t i = 0; i < count; ++i) {
    const Fragment& fragment = fragments_[i];
    const float* p = &rgba_[4 * i];
    row[static_cast<std::size_t>(fragment.column)] += fragment.share * cv::Vec4f(p[0], p[1], p[2], 1.0f);
  }
}

}  // namespace mixstage
