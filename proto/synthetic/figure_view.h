// SPDX-License-Identifier: Apache-2.0
//
// The figure as a camera's kernels want it, and the light he stands in.
#pragma once

#include <array>
#include <vector>

#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "proto/synthetic/figure.h"
#include "proto/synthetic/figure_kernels.h"
#include "proto/synthetic/room_light.h"

namespace mixstage {

struct FigureView {
  std::array<PartView, Figure::kMaxParts> parts;
  int count = 0;
  // px, inclusive, cut to the picture: all parts; empty (u0 > u1) when he is out of the picture.
  int u0 = 0, u1 = -1, v0 = 0, v1 = -1;
};

// margin_px: how far beyond its outline a part may be asked for.
void ViewFigure(const Figure& figure, const PinholeCamera& camera, const RigidTransform& T_world_camera,
                int margin_px, FigureView& view);

struct Casters {
  std::array<Caster, Figure::kMaxParts> casters;
  int count = 0;
};
void CastersOf(const Figure& figure, Casters& casters);

// Bounced light where the figure can be, from probes set up once.
class FigureLight {
 public:
  explicit FigureLight(const RoomLight& light);
  // Light for a figure that stands at (x, y).
  void At(const Eigen::Vector2d& body, BodyLight& out) const;

 private:
  static constexpr int kX = 4, kY = 6, kZ = 2;
  BodyLight lamps_;
  std::vector<Eigen::Vector3f> probes_;  // [z][y][x][face]
};

}  // namespace mixstage
