// SPDX-License-Identifier: Apache-2.0
//
// The synthetic room: its solids, what a ray meets first, and what the surfaces are made of.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "proto/synthetic/round_cone.h"

namespace mixstage {

enum class Surface : std::uint8_t {
  kFloor = 1,
  kRug,
  kWallBack,
  kWallLeft,
  kWallRight,
  kWallFront,
  kCeiling,
  kSoftbox,  // the shining face of the light under the ceiling
  kPane,     // the window's glass with the day behind it
  kPaint,    // plain: the solid's own colour
  kOak,
  kWalnut,
  kDoors,  // the sideboard's front
  kPainting,
  kCloth,
  kLeaf,
  kCeramic,
  kLampShade,
  kFigure,
};

struct Ray {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();      // world, m
  Eigen::Vector3d direction = Eigen::Vector3d::UnitX();  // world, unit length
};

struct Hit {
  double range_m = 0;                                 // along the ray
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // world, unit, towards the ray's side
  Surface surface = Surface::kFloor;
  Eigen::Vector3f albedo = Eigen::Vector3f::Zero();  // linear 0..1, before texture for RoomHit
};

// One solid of the furniture. Boxes stand on a floor turned by yaw; frusta are upright.
struct Solid {
  enum class Kind : std::uint8_t { kBox = 1, kFrustum, kRoundCone };
  Kind kind = Kind::kBox;
  Surface surface = Surface::kPaint;
  Eigen::Vector3f color = Eigen::Vector3f::Constant(0.5f);  // linear albedo
  Eigen::Vector3d center = Eigen::Vector3d::Zero();         // box: centre; frustum: centre of its bottom
  Eigen::Vector3d half =
      Eigen::Vector3d::Zero();      // box: half sizes; frustum: bottom radius, top radius, height
  double cos_yaw = 1, sin_yaw = 0;  // box
  RoundCone cone;
  bool casts_lamp_shadow = true;  // the lamp's own parts let its light out

  [[nodiscard]] Eigen::AlignedBox3d Bounds() const;
};

// What a point of a surface is made of, for the eye.
struct RoomMaterial {
  Eigen::Vector3f albedo = Eigen::Vector3f::Zero();    // linear
  Eigen::Vector3f emission = Eigen::Vector3f::Zero();  // radiance x pi, in units of the picture's white
  float gloss = 0;                                     // strength of the mirror-like part, 0..1
};

enum class Occluders { kAll = 1, kAllButLamp };

class Room {
 public:
  Room();

  struct Found {
    double range_m = 0;
    Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
    Surface surface = Surface::kFloor;
    int solid = -1;  // index of the solid, -1 for the shell
  };
  // The first surface along a ray; a ray from inside the room always meets one. Any thread.
  [[nodiscard]] Found Trace(const Ray& ray) const;
  // Whether anything stands between the ray's origin and `range_m` along it.
  [[nodiscard]] bool Blocked(const Ray& ray, double range_m, Occluders occluders) const;

  // With texture, as a picture shows it.
  [[nodiscard]] RoomMaterial MaterialAt(const Found& found, const Eigen::Vector3d& point) const;
  // Without: the mean colour, for light that has bounced.
  [[nodiscard]] RoomMaterial PlainMaterial(const Found& found) const;

  [[nodiscard]] const std::vector<Solid>& solids() const { return solids_; }

 private:
  struct Node {
    Eigen::AlignedBox3d box;
    int first = 0, count = 0;  // count > 0: a leaf's solids in order_; else children at first, first + 1
  };
  void Build(int node, int first, int count);
  template <typename Visit>
  void Walk(const Ray& ray, const double& limit_m, Visit visit) const;

  std::vector<Solid> solids_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

// The furniture of the plan.
std::vector<Solid> Furniture();

}  // namespace mixstage
