// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/lens.h"

namespace mixstage {

Lens LensOf(const PinholeCamera& c) {
  return {LensKind::kPinhole,
          c.width,
          c.height,
          {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3, c.k4, c.k5, c.k6},
          0,
          {0, 1, 2, 3, 4, 5}};
}

Lens LensOf(const FisheyeCamera& c) {
  return {LensKind::kFisheye, c.width,
          c.height,           {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.k3, c.k4},
          c.max_angle_rad,    {0, 1, 2, 3, 4, 5, 6, 7}};
}

PinholeCamera PinholeOf(const Lens& lens) {
  const auto& n = lens.numbers;
  return {lens.width, lens.height, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11]};
}

FisheyeCamera FisheyeOf(const Lens& lens) {
  const auto& n = lens.numbers;
  return {lens.width, lens.height, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], lens.max_angle_rad};
}

std::optional<Eigen::Vector2d> Lens::Project(const Eigen::Vector3d& p) const {
  return kind == LensKind::kPinhole ? PinholeOf(*this).Project(p) : FisheyeOf(*this).Project(p);
}

std::optional<Eigen::Vector3d> Lens::Unproject(const Eigen::Vector2d& pixel) const {
  if (kind == LensKind::kFisheye) return FisheyeOf(*this).Unproject(pixel);
  const auto p = PinholeOf(*this).Unproject(pixel);
  if (!p) return std::nullopt;
  return Eigen::Vector3d(p->x(), p->y(), 1).normalized();
}

const char* LensNumberName(LensKind kind, int index) {
  static constexpr std::array<const char*, kLensNumbers> kPinholeNames = {"fx", "fy", "cx", "cy", "k1", "k2",
                                                                          "p1", "p2", "k3", "k4", "k5", "k6"};
  static constexpr std::array<const char*, kLensNumbers> kFisheyeNames = {"fx", "fy", "cx", "cy", "k1", "k2",
                                                                          "k3", "k4", "",   "",   "",   ""};
  return (kind == LensKind::kPinhole ? kPinholeNames : kFisheyeNames).at(static_cast<std::size_t>(index));
}

}  // namespace mixstage
