// SPDX-License-Identifier: Apache-2.0
//
// The surfaces of the synthetic room, point by point. Albedos are linear; sizes in metres.
#include <algorithm>
#include <cmath>

#include "proto/synthetic/room.h"
#include "proto/synthetic/room_light.h"
#include "proto/synthetic/room_plan.h"
#include "proto/synthetic/texture.h"

namespace mixstage {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
namespace plan = room_plan;

const Vector3f kBackWall(0.36f, 0.41f, 0.365f);
const Vector3f kWarmWall(0.66f, 0.63f, 0.58f);
const Vector3f kReveal(0.78f, 0.77f, 0.74f);

// Boards along x, 13 cm wide, joints staggered; `u` along the grain, `w` across it.
Vector3f Wood(const Vector3f& base, double u, double w, float contrast) {
  const float streaks = Fbm(1.3 * u, 38 * w);
  const float fibre = ValueNoise(9 * u, 310 * w);
  const float rings = 0.5f + 0.5f * std::sin(static_cast<float>(60 * w + 5 * Fbm(0.9 * u, 6 * w)));
  const float shade =
      1 + contrast * (0.75f * (streaks - 0.5f) + 0.28f * (fibre - 0.5f) + 0.16f * (rings - 0.5f));
  return shade * base;
}

RoomMaterial FloorBoards(const Vector3d& p) {
  constexpr double kBoard = 0.135;
  constexpr double kLength = 1.7;
  const int row = static_cast<int>(std::floor(p.y() / kBoard));
  const double along = p.x() + kLength * Unit(row, 11);
  const int board = static_cast<int>(std::floor(along / kLength));
  const float tone = Unit(row, 100 + board);
  const float warm = Unit(row + 517, board);
  const Vector3f base =
      (0.80f + 0.40f * tone) * Vector3f(0.36f, 0.215f + 0.012f * warm, 0.110f + 0.018f * warm);
  RoomMaterial m;
  m.albedo = Wood(base, along + 3.7 * row, p.y() + 0.31 * board, 0.75f);
  const double to_side = std::min(p.y() - row * kBoard, (row + 1) * kBoard - p.y());
  const double to_end = std::min(along - board * kLength, (board + 1) * kLength - along);
  const float gap =
      std::max(1 - static_cast<float>(to_side) / 0.0022f, 1 - static_cast<float>(to_end) / 0.0018f);
  m.albedo *= 1 - 0.72f * std::clamp(gap, 0.f, 1.f);
  m.gloss = (0.62f + 0.3f * Fbm(2.3 * p.x(), 11 * p.y())) * (1 - std::clamp(gap, 0.f, 1.f));
  return m;
}

constexpr double kRugX0 = 2.98, kRugX1 = 4.46, kRugY0 = -0.72, kRugY1 = 1.62;

bool OnRug(const Vector3d& p) { return p.x() > kRugX0 && p.x() < kRugX1 && p.y() > kRugY0 && p.y() < kRugY1; }

// A woven rug: cream field with a grid of lozenges, two terracotta bands, a fringe at the short ends.
RoomMaterial RugAt(const Vector3d& p) {
  const Vector3f cream(0.60f, 0.54f, 0.45f);
  const Vector3f terracotta(0.42f, 0.165f, 0.095f);
  const Vector3f slate(0.125f, 0.15f, 0.165f);
  const double edge =
      std::min(std::min(p.x() - kRugX0, kRugX1 - p.x()), std::min(p.y() - kRugY0, kRugY1 - p.y()));
  auto band = [&](double from, double to) {
    return SmoothStep(0, 0.006f, static_cast<float>(edge - from)) *
           SmoothStep(0, 0.006f, static_cast<float>(to - edge));
  };
  Vector3f color = cream;
  const double lozenge_x = std::abs(std::remainder(p.x() - 3.72, 0.37)) / 0.37;
  const double lozenge_y = std::abs(std::remainder(p.y() - 0.45, 0.26)) / 0.26;
  const float inside = static_cast<float>(0.5 - lozenge_x - lozenge_y);
  const float line = 1 - SmoothStep(0.02f, 0.045f, std::abs(inside));
  const float field = SmoothStep(0.18f, 0.19f, static_cast<float>(edge));
  color += field * 0.65f * line * (slate - color);
  const float heart = SmoothStep(0.36f, 0.39f, inside);
  color += field * 0.8f * heart * (terracotta - color);
  color += band(0.045, 0.105) * (terracotta - color);
  color += band(0.13, 0.145) * (slate - color);
  const float weave = 0.90f + 0.2f * ValueNoise(260 * p.x(), 130 * p.y());
  const float worn = 0.92f + 0.16f * Fbm(2.2 * p.x(), 2.2 * p.y());
  RoomMaterial m;
  m.albedo = weave * worn * color * (0.80f + 0.20f * SmoothStep(0, 0.012f, static_cast<float>(edge)));
  return m;
}

Vector3f Plaster(const Vector3f& base, double u, double v) {
  return (0.955f + 0.06f * Fbm(1.1 * u, 1.1 * v) + 0.04f * Fbm(23 * u, 23 * v)) * base;
}

// An abstract: a low sun over hills.
Vector3f Picture(double across, double up) {  // 0..1 both
  const float x = static_cast<float>(across);
  const float y = static_cast<float>(up);
  Vector3f color = Vector3f(0.66f, 0.55f, 0.42f) + (0.9f - y) * Vector3f(0.10f, -0.08f, -0.14f);
  const float sun = std::hypot((x - 0.66f) * 1.25f, y - 0.63f);
  color += SmoothStep(0.135f, 0.125f, sun) * (Vector3f(0.62f, 0.22f, 0.09f) - color);
  const Vector3f hills[] = {{0.42f, 0.36f, 0.31f}, {0.17f, 0.27f, 0.28f}, {0.055f, 0.12f, 0.155f}};
  for (int i = 0; i < 3; ++i) {
    const float k = static_cast<float>(i);
    const float ridge = 0.50f - 0.145f * k + 0.075f * std::sin(4.2f * x + 2.1f * k) +
                        0.05f * static_cast<float>(Fbm(3.5 * across + 5 * i, 3.3 * i));
    color += SmoothStep(ridge + 0.006f, ridge - 0.006f, y) * (hills[i] - color);
  }
  return (0.88f + 0.22f * Fbm(90 * across, 22 * up)) * color;
}

// The day outside, out of focus: sky over trees. Radiance, white = 1.
Vector3f Outside(const Vector3d& p) {
  const auto height = static_cast<float>((p.z() - plan::kWindowZ0) / (plan::kWindowZ1 - plan::kWindowZ0));
  const Vector3f sky = Vector3f(1.25f, 1.42f, 1.62f) - height * Vector3f(0.30f, 0.18f, 0.02f);
  const float leaves = 0.5f * Fbm(2.6 * p.x(), 2.9 * p.z()) + 0.5f * ValueNoise(6 * p.x() + 3, 6 * p.z());
  const Vector3f trees = Vector3f(0.30f, 0.46f, 0.20f) + leaves * Vector3f(0.42f, 0.50f, 0.22f);
  const float ridge = 0.34f + 0.22f * ValueNoise(1.7 * p.x(), 4.0) + 0.10f * ValueNoise(5.1 * p.x(), 1.0);
  return trees + SmoothStep(ridge - 0.10f, ridge + 0.10f, height) * (sky - trees);
}

RoomMaterial Doors(const Solid& solid, const Room::Found& found, const Vector3d& p) {
  RoomMaterial m;
  m.albedo = Wood(solid.color, p.y(), p.z(), 0.85f);
  m.gloss = 0.25f;
  if (found.normal.x() < -0.5) {
    const double to_gap = std::min(std::abs(p.y() - 0.35), std::abs(p.y() - 0.95));
    const double to_frame =
        std::min(std::min(p.y() + 0.2, 1.6 - p.y()), std::min(p.z() - 0.17, 0.72 - p.z()));
    if (to_gap < 0.0025) m.albedo *= 0.2f;
    if (to_frame < 0.018) m.albedo *= to_frame > 0.0155 ? 0.25f : 0.85f;
  }
  return m;
}

}  // namespace

RoomMaterial Room::PlainMaterial(const Found& found) const {
  RoomMaterial m;
  switch (found.surface) {
    case Surface::kFloor:
    case Surface::kRug:
      m.albedo = Vector3f(0.36f, 0.24f, 0.145f);
      break;
    case Surface::kWallBack:
      m.albedo = kBackWall;
      break;
    case Surface::kWallLeft:
    case Surface::kWallRight:
    case Surface::kWallFront:
      m.albedo = kWarmWall;
      break;
    case Surface::kCeiling:
      m.albedo = Vector3f::Constant(0.76f);
      break;
    case Surface::kPane:
      break;  // its light is a lamp's: counted by sampling it
    case Surface::kSoftbox:
      m.albedo = Vector3f::Constant(0.76f);
      break;
    case Surface::kLampShade:
      m.albedo = solids_[static_cast<std::size_t>(found.solid)].color;
      break;
    default:
      m.albedo = found.solid >= 0 ? solids_[static_cast<std::size_t>(found.solid)].color : kReveal;
  }
  return m;
}

RoomMaterial Room::MaterialAt(const Found& found, const Vector3d& p) const {
  RoomMaterial m = PlainMaterial(found);
  switch (found.surface) {
    case Surface::kFloor:
      return OnRug(p) ? RugAt(p) : FloorBoards(p);
    case Surface::kWallBack:
      m.albedo = Plaster(kBackWall, p.y(), p.z());
      break;
    case Surface::kWallLeft:
    case Surface::kWallRight:
    case Surface::kWallFront:
      m.albedo = Plaster(kWarmWall, p.x() + p.y(), p.z());
      break;
    case Surface::kPane:
      m.emission = Outside(p);
      m.gloss = 0;
      break;
    case Surface::kSoftbox:
      m.emission = SoftboxLight().radiance;
      break;
    case Surface::kOak: {
      const Solid& s = solids_[static_cast<std::size_t>(found.solid)];
      const bool upright = s.half.z() > s.half.y();
      m.albedo =
          upright ? Wood(s.color, p.z(), p.y() + p.x(), 0.55f) : Wood(s.color, p.y(), p.z() + p.x(), 0.55f);
      m.gloss = 0.15f;
      break;
    }
    case Surface::kWalnut:
      m.albedo = Wood(m.albedo, p.y(), p.x() + p.z(), 0.85f);
      m.gloss = 0.45f;
      break;
    case Surface::kDoors:
      return Doors(solids_[static_cast<std::size_t>(found.solid)], found, p);
    case Surface::kPainting:
      m.albedo = Picture((0.995 - p.y()) / 0.79, (p.z() - 1.205) / 0.63);
      break;
    case Surface::kCloth:
      m.albedo *= 0.93f + 0.14f * ValueNoise(210 * p.x() + 90 * p.y(), 210 * p.z());
      break;
    case Surface::kLeaf:
      m.albedo *= 0.85f + 0.3f * Fbm(30 * p.x(), 30 * (p.y() + p.z()));
      m.gloss = 0.3f;
      break;
    case Surface::kCeramic:
      m.gloss = 0.55f;
      break;
    case Surface::kLampShade: {
      // Light inside: brightest at the height of the bulb.
      const auto from_bulb = static_cast<float>((p.z() - plan::kLampZ) / 0.14);
      m.emission = (0.35f + 0.85f * std::exp(-from_bulb * from_bulb)) * Vector3f(1.35f, 0.86f, 0.42f);
      break;
    }
    default:
      break;
  }
  return m;
}

}  // namespace mixstage
