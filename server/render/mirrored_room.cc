// SPDX-License-Identifier: Apache-2.0
#include "server/render/mirrored_room.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "proto/base/srgb.h"

namespace mixstage {
namespace {

constexpr int kTexture = 2048;  // px a side: a room of 160 degrees as a half-size picture resolves it
constexpr float kSigmas = 3, kLeastOff_m = 0.01f, kMostOff_m = 0.1f;

}  // namespace

MirroredRoom::MirroredRoom(const RoomModel& room, float sigma_m, const PinholeCamera& mirrored)
    : positions_(room.positions),
      uvs_(room.uvs),
      indices_(room.indices),
      off_m_(std::clamp(kSigmas * sigma_m, kLeastOff_m, kMostOff_m)) {
  MIX_CHECK(room.Validate().has_value());
  const int side = std::max(room.texture_bgr.cols, room.texture_bgr.rows);
  const double scale = std::min(1.0, static_cast<double>(kTexture) / side);
  cv::resize(room.texture_bgr, texture_bgr_, {}, scale, scale, cv::INTER_AREA);
  auto rasteriser = CreateRasteriser(RasterBackend::kCpu, mirrored, {});
  MIX_CHECK(rasteriser.has_value());
  rasteriser_ = std::move(*rasteriser);
}

void MirroredRoom::Draw(const MirrorView& view, const cv::Rect& window, const cv::Mat2f& rays,
                        cv::Mat3f& radiance, cv::Mat1f& depth_m) {
  const RigidTransform T_camera_world = view.T_scene_mirrored.inverse();
  const Eigen::Vector3d normal = T_camera_world.linear() * view.plane.head<3>();
  const double d = view.plane.w() - normal.dot(T_camera_world.translation());
  PictureGrid grid{.region_px = window};
  grid.half_space << normal.cast<float>(), static_cast<float>(d) - off_m_;
  rasteriser_->Begin(grid);
  rasteriser_->Draw({positions_, indices_}, Eigen::Affine3d(T_camera_world.matrix()), 0, Faces::kBoth);
  const VisibilityBuffer& visible = rasteriser_->Finish();
  const Eigen::Matrix3f R = view.T_scene_mirrored.linear().cast<float>();
  const Eigen::Vector3f eye = view.T_scene_mirrored.translation().cast<float>();
  const SrgbTables& srgb = SrgbTables::Get();
  radiance.create(window.size());
  depth_m.create(window.size());
  for (int y = 0; y < window.height; ++y) {
    for (int x = 0; x < window.width; ++x) {
      radiance(y, x) = cv::Vec3f::all(0);
      depth_m(y, x) = 0;
      const std::int32_t triangle = visible.triangle(y, x);
      const cv::Vec2f& ray = rays(window.y + y, window.x + x);
      if (triangle < 0 || ray[0] != ray[0]) continue;
      const std::uint32_t* corner = &indices_[3 * static_cast<std::size_t>(triangle)];
      const Eigen::Vector3f& a = positions_[corner[0]];
      const Eigen::Vector3f ab = positions_[corner[1]] - a, ac = positions_[corner[2]] - a;
      const Eigen::Vector3f along = R * Eigen::Vector3f(ray[0], ray[1], 1);
      const Eigen::Vector3f across = along.cross(ac);
      const float volume = ab.dot(across);
      if (!(std::abs(volume) > 1e-12f)) continue;
      const Eigen::Vector3f from_a = eye - a;
      const float s = std::clamp(from_a.dot(across) / volume, 0.0f, 1.0f);
      const float t = std::clamp(along.dot(from_a.cross(ab)) / volume, 0.0f, 1.0f);
      const Eigen::Vector2f uv =
          uvs_[corner[0]] + s * (uvs_[corner[1]] - uvs_[corner[0]]) + t * (uvs_[corner[2]] - uvs_[corner[0]]);
      const auto texel = [](float at, int size) {
        return std::clamp(static_cast<int>(at * static_cast<float>(size)), 0, size - 1);
      };
      const cv::Vec3b& bgr = texture_bgr_(texel(uv.y(), texture_bgr_.rows), texel(uv.x(), texture_bgr_.cols));
      radiance(y, x) = {srgb.ToLinear(bgr[2]), srgb.ToLinear(bgr[1]), srgb.ToLinear(bgr[0])};
      depth_m(y, x) = visible.depth_m(y, x);
    }
  }
}

}  // namespace mixstage
