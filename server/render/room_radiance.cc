// SPDX-License-Identifier: Apache-2.0
#include "server/render/room_radiance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "proto/base/srgb.h"

namespace mixstage {
namespace {

constexpr float kPatch_m = 0.3f;
constexpr int kPatchTexture = 1024;  // px a side: a patch's colour needs no more
constexpr int kClipped = 250;        // LampConfig's: it shines itself, and is one of the lamps

cv::Mat3f LightOf(const cv::Mat3b& bgr) {
  cv::Mat3b small = bgr;
  const int side = std::max(bgr.cols, bgr.rows);
  if (side > kPatchTexture) {
    const double scale = static_cast<double>(kPatchTexture) / side;
    cv::resize(bgr, small, {}, scale, scale, cv::INTER_AREA);
  }
  const SrgbTables& srgb = SrgbTables::Get();
  cv::Mat3f light(small.size());
  for (int y = 0; y < small.rows; ++y) {
    for (int x = 0; x < small.cols; ++x) {
      const cv::Vec3b& p = small(y, x);
      const bool lamp = std::min({p[0], p[1], p[2]}) >= kClipped;
      light(y, x) =
          lamp ? cv::Vec3f::all(0) : cv::Vec3f(srgb.ToLinear(p[2]), srgb.ToLinear(p[1]), srgb.ToLinear(p[0]));
    }
  }
  return light;
}

}  // namespace

RoomRadiance::RoomRadiance(const RoomModel& room, const std::vector<RoomLamp>& lamps) {
  MIX_CHECK(room.Validate().has_value());
  for (const RoomLamp& lamp : lamps) {
    Light light;
    light.id = static_cast<std::uint32_t>(lamps_.size() + 1);
    light.name = lamp.name;
    light.shape = AreaLight{lamp.center, lamp.edge_u, lamp.edge_v};
    light.color = lamp.color.cast<float>();
    light.intensity = static_cast<float>(lamp.intensity);
    lamps_.push_back(std::move(light));
  }
  const cv::Mat3f light = LightOf(room.texture_bgr);
  struct Sum {
    Eigen::Vector3f center = Eigen::Vector3f::Zero(), facing = Eigen::Vector3f::Zero(),
                    radiance = Eigen::Vector3f::Zero();
    float area = 0;
  };
  std::map<std::array<int, 4>, Sum> sums;
  for (std::size_t i = 0; i < room.indices.size(); i += 3) {
    const std::uint32_t* corner = &room.indices[i];
    const Eigen::Vector3f& a = room.positions[corner[0]];
    const Eigen::Vector3f& b = room.positions[corner[1]];
    const Eigen::Vector3f& c = room.positions[corner[2]];
    const Eigen::Vector3f facing = 0.5f * (b - a).cross(c - a);
    const float area = facing.norm();
    if (!(area > 0)) continue;
    // A large triangle is many patches.
    const float longest =
        std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
    const int n = std::clamp(static_cast<int>(std::ceil(longest / kPatch_m)), 1, 32);
    Eigen::Index axis = 0;
    facing.cwiseAbs().maxCoeff(&axis);
    const int side = 2 * static_cast<int>(axis) + (facing[axis] < 0 ? 1 : 0);
    const float part = 1.0f / static_cast<float>(n * n);
    for (int v = 0; v < n; ++v) {
      for (int k = 0; k < 2 * (n - v) - 1; ++k) {
        // The n^2 small triangles: k even upright, k odd between them.
        const float third = k % 2 == 0 ? 1.0f / 3 : 2.0f / 3;
        const float s = (static_cast<float>(k / 2) + third) / static_cast<float>(n);
        const float t = (static_cast<float>(v) + third) / static_cast<float>(n);
        const Eigen::Vector3f p = a + s * (b - a) + t * (c - a);
        const Eigen::Vector2f uv = room.uvs[corner[0]] + s * (room.uvs[corner[1]] - room.uvs[corner[0]]) +
                                   t * (room.uvs[corner[2]] - room.uvs[corner[0]]);
        const cv::Point texel(
            std::clamp(static_cast<int>(uv.x() * static_cast<float>(light.cols)), 0, light.cols - 1),
            std::clamp(static_cast<int>(uv.y() * static_cast<float>(light.rows)), 0, light.rows - 1));
        const cv::Vec3f& rgb = light(texel);
        Sum& sum = sums[{static_cast<int>(std::floor(p.x() / kPatch_m)),
                         static_cast<int>(std::floor(p.y() / kPatch_m)),
                         static_cast<int>(std::floor(p.z() / kPatch_m)), side}];
        sum.center += part * area * p;
        sum.facing += part * facing;
        sum.radiance += part * area * Eigen::Vector3f(rgb[0], rgb[1], rgb[2]);
        sum.area += part * area;
      }
    }
  }
  patches_.reserve(sums.size());
  for (const auto& [cell, sum] : sums)
    patches_.push_back({sum.center / sum.area, sum.facing, sum.radiance / sum.area});
}

AmbientLight RoomRadiance::At(const Eigen::Vector3d& point) const {
  AmbientSum sum;
  const Eigen::Vector3f p = point.cast<float>();
  for (const Patch& patch : patches_) {
    const Eigen::Vector3f to = patch.center - p;
    const float d2 = to.squaredNorm();
    const float d = std::sqrt(d2);
    const float seen = -patch.facing.dot(to);  // area x cosine x distance
    if (!(seen > 0) || !(d > 1e-3f)) continue;
    // As a disc on its axis: no pole at the patch itself.
    const float area = seen / d;
    sum.Add(to / d, area / (d2 + area * std::numbers::inv_pi_v<float>), patch.radiance);
  }
  return sum.Finish();
}

}  // namespace mixstage
