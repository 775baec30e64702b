// SPDX-License-Identifier: Apache-2.0
//
// What stands in the synthetic room: a list, read from the window round to the bookshelf.
#include <cmath>
#include <numbers>

#include "proto/synthetic/room.h"
#include "proto/synthetic/room_plan.h"
#include "proto/synthetic/texture.h"

namespace mixstage {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
namespace plan = room_plan;

const Vector3f kWhite(0.80f, 0.79f, 0.76f);
const Vector3f kBlack(0.025f, 0.024f, 0.023f);
const Vector3f kBrass(0.55f, 0.40f, 0.16f);

class Builder {
 public:
  // A box from corner to corner.
  Solid& Box(const Vector3d& from, const Vector3d& to, Surface surface, const Vector3f& color) {
    Solid s;
    s.kind = Solid::Kind::kBox;
    s.center = 0.5 * (from + to);
    s.half = 0.5 * (to - from);
    s.surface = surface;
    s.color = color;
    return Add(s);
  }
  Solid& Turned(Solid& box, double yaw_deg) {
    box.cos_yaw = std::cos(yaw_deg * std::numbers::pi / 180);
    box.sin_yaw = std::sin(yaw_deg * std::numbers::pi / 180);
    return box;
  }
  Solid& Frustum(const Vector3d& bottom, double bottom_radius, double top_radius, double height,
                 Surface surface, const Vector3f& color) {
    Solid s;
    s.kind = Solid::Kind::kFrustum;
    s.center = bottom;
    s.half = Vector3d(bottom_radius, top_radius, height);
    s.surface = surface;
    s.color = color;
    return Add(s);
  }
  Solid& Cone(const RoundCone& cone, Surface surface, const Vector3f& color) {
    Solid s;
    s.kind = Solid::Kind::kRoundCone;
    s.cone = cone;
    s.surface = surface;
    s.color = color;
    return Add(s);
  }
  std::vector<Solid> Take() { return std::move(solids_); }

 private:
  Solid& Add(const Solid& s) { return solids_.emplace_back(s); }
  std::vector<Solid> solids_;
};

void AddWindow(Builder& b) {
  const double y0 = plan::kPaneY - 0.07;
  const double y1 = plan::kPaneY - 0.02;
  const double middle = 0.5 * (plan::kWindowX0 + plan::kWindowX1);
  for (const double x : {plan::kWindowX0 + 0.03, 0.5 * (plan::kWindowX0 + middle), middle,
                         0.5 * (middle + plan::kWindowX1), plan::kWindowX1 - 0.03}) {
    b.Box({x - 0.025, y0, plan::kWindowZ0}, {x + 0.025, y1, plan::kWindowZ1}, Surface::kPaint, kWhite);
  }
  for (const double z : {plan::kWindowZ0 + 0.03, plan::kWindowZ1 - 0.42, plan::kWindowZ1 - 0.03}) {
    b.Box({plan::kWindowX0, y0, z - 0.025}, {plan::kWindowX1, y1, z + 0.025}, Surface::kPaint, kWhite);
  }
  b.Box({plan::kWindowX0 - 0.08, plan::kLeftY - 0.09, plan::kWindowZ0 - 0.045},
        {plan::kWindowX1 + 0.08, plan::kLeftY + 0.19, plan::kWindowZ0 - 0.005}, Surface::kPaint, kWhite);
  // Curtain: hanging folds beside the window, and their rod.
  const Vector3f linen(0.66f, 0.60f, 0.50f);
  b.Cone(MakeRoundCone({2.2, 2.47, 2.42}, {5.45, 2.47, 2.42}, 0.014, 0.014), Surface::kPaint, kBlack);
  for (int i = 0; i < 9; ++i) {
    const double x = 4.95 + 0.052 * i;
    const double sway = 0.012 * std::sin(1.9 * i);
    b.Cone(MakeRoundCone({x + sway, 2.47 + sway, 0.03}, {x, 2.47 - 0.3 * sway, 2.40}, 0.040, 0.033),
           Surface::kCloth, linen);
  }
}

void AddBench(Builder& b) {
  const Vector3f oak(0.42f, 0.27f, 0.15f);
  b.Box({3.45, 2.14, 0.36}, {4.72, 2.54, 0.40}, Surface::kOak, oak);
  for (const double x : {3.55, 4.62}) {
    for (const double y : {2.19, 2.49}) b.Frustum({x, y, 0}, 0.017, 0.024, 0.36, Surface::kOak, oak);
  }
  b.Cone(MakeRoundCone({3.56, 2.34, 0.445}, {4.61, 2.34, 0.445}, 0.13, 0.13, Vector3d::UnitY(), 1.4, 0.36),
         Surface::kCloth, Vector3f(0.50f, 0.46f, 0.40f));
  auto pillow = [&](double x, double lean, const Vector3f& color) {
    const Vector3d up(0.05, lean, 1);
    const Eigen::Matrix3d axes =
        (Eigen::Matrix3d() << Vector3d(1, 0, 0), up.normalized().cross(Vector3d(1, 0, 0)), up.normalized())
            .finished();
    b.Cone(MakeEllipsoid({x, 2.43, 0.64}, axes, {0.21, 0.075, 0.19}), Surface::kCloth, color);
  };
  pillow(4.45, 0.35, Vector3f(0.52f, 0.17f, 0.09f));
  pillow(4.10, 0.42, Vector3f(0.60f, 0.38f, 0.10f));
}

void AddPlant(Builder& b) {
  const Vector3d foot(5.17, 2.02, 0);
  b.Frustum(foot, 0.15, 0.2, 0.36, Surface::kCeramic, Vector3f(0.55f, 0.53f, 0.49f));
  b.Frustum(foot + Vector3d(0, 0, 0.3), 0.185, 0.185, 0.062, Surface::kPaint,
            Vector3f(0.05f, 0.035f, 0.025f));
  for (int stem = 0; stem < 4; ++stem) {
    const double turn = 1.57 * stem + 0.5;
    const double lean = 0.08 + 0.13 * Unit(stem, 3);
    const double height = 0.95 + 0.42 * Unit(stem, 7);
    const Vector3d a = foot + Vector3d(0.04 * std::cos(turn), 0.04 * std::sin(turn), 0.34);
    const Vector3d tip = a + Vector3d(lean * std::cos(turn), lean * std::sin(turn), height);
    b.Cone(MakeRoundCone(a, tip, 0.013, 0.006), Surface::kPaint, Vector3f(0.16f, 0.12f, 0.06f));
    for (int i = 0; i < 13; ++i) {
      const double along = 0.18 + 0.85 * (i + 0.5) / 13;
      const double around = turn + 2.4 * i + 0.6 * Unit(stem, i);
      const double rise = 0.15 + 0.75 * along + 0.25 * Unit(i, stem + 40);
      Vector3d out(std::cos(around) * std::cos(rise), std::sin(around) * std::cos(rise), std::sin(rise));
      const double size = 0.085 + 0.05 * Unit(i, stem + 20);
      const Vector3d stalk = a + along * (tip - a);
      const Vector3d side = out.cross(Vector3d::UnitZ()).normalized();
      const Vector3d face = side.cross(out);
      const Eigen::Matrix3d axes = (Eigen::Matrix3d() << side, face, out).finished();
      const float shade = 0.75f + 0.5f * Unit(stem * 31 + i, 5);
      b.Cone(MakeEllipsoid(stalk + 1.05 * size * out, axes, {0.5 * size, 0.006, size}), Surface::kLeaf,
             shade * Vector3f(0.075f, 0.17f, 0.05f));
    }
  }
}

void AddSideboard(Builder& b) {
  const Vector3f walnut(0.20f, 0.105f, 0.055f);
  b.Box({5.16, -0.2, 0.17}, {5.57, 1.6, 0.72}, Surface::kDoors, walnut);
  b.Box({5.14, -0.22, 0.72}, {5.58, 1.62, 0.745}, Surface::kWalnut, walnut);
  for (const double y : {-0.1, 1.5}) {
    for (const double x : {5.22, 5.5}) b.Frustum({x, y, 0}, 0.012, 0.022, 0.17, Surface::kPaint, kBlack);
  }
  for (const double y : {0.335, 0.365, 0.965, 0.935}) {
    b.Cone(MakeRoundCone({5.145, y, 0.44}, {5.145, y, 0.54}, 0.006, 0.006), Surface::kPaint, kBrass);
  }
  // Lamp.
  const Vector3d lamp(plan::kLampX, plan::kLampY, 0.745);
  b.Cone(MakeEllipsoid(lamp + Vector3d(0, 0, 0.1), Eigen::Matrix3d::Identity(), {0.085, 0.085, 0.1}),
         Surface::kCeramic, Vector3f(0.10f, 0.17f, 0.19f))
      .casts_lamp_shadow = false;
  b.Frustum(lamp + Vector3d(0, 0, 0.18), 0.012, 0.012, 0.1, Surface::kPaint, kBrass).casts_lamp_shadow =
      false;
  b.Frustum(lamp + Vector3d(0, 0, 0.25), 0.165, 0.115, 0.24, Surface::kLampShade,
            Vector3f(0.75f, 0.66f, 0.50f))
      .casts_lamp_shadow = false;
  // Books lying, a bowl on them, a vase.
  b.Turned(b.Box({5.25, 0.20, 0.745}, {5.43, 0.46, 0.775}, Surface::kPaint, Vector3f(0.42f, 0.10f, 0.07f)),
           4);
  b.Turned(b.Box({5.26, 0.22, 0.775}, {5.42, 0.45, 0.80}, Surface::kPaint, Vector3f(0.62f, 0.58f, 0.50f)),
           -7);
  b.Turned(b.Box({5.27, 0.23, 0.80}, {5.42, 0.44, 0.822}, Surface::kPaint, Vector3f(0.07f, 0.13f, 0.19f)), 9);
  b.Frustum({5.35, 0.335, 0.822}, 0.035, 0.075, 0.05, Surface::kCeramic, Vector3f(0.62f, 0.60f, 0.55f));
  b.Cone(MakeEllipsoid({5.36, -0.02, 0.745 + 0.11}, Eigen::Matrix3d::Identity(), {0.07, 0.07, 0.11}),
         Surface::kCeramic, Vector3f(0.60f, 0.29f, 0.16f));
  b.Frustum({5.36, -0.02, 0.93}, 0.028, 0.036, 0.09, Surface::kCeramic, Vector3f(0.60f, 0.29f, 0.16f));
  // The painting and its frame.
  b.Box({5.565, 0.18, 1.18}, {5.6, 1.02, 1.86}, Surface::kPaint, Vector3f(0.30f, 0.19f, 0.10f));
  b.Box({5.558, 0.205, 1.205}, {5.57, 0.995, 1.835}, Surface::kPainting, kWhite);
}

void AddBookshelf(Builder& b) {
  const Vector3f oak(0.44f, 0.29f, 0.165f);
  const double x0 = 5.29;
  const double y0 = -1.5;
  const double y1 = -0.52;
  b.Box({5.57, y0, 0}, {5.59, y1, 2.04}, Surface::kOak, 0.8f * oak);
  for (const double y : {y0, y1 - 0.026}) b.Box({x0, y, 0}, {5.59, y + 0.026, 2.04}, Surface::kOak, oak);
  constexpr double kShelves[] = {0.07, 0.45, 0.83, 1.21, 1.59, 2.014};
  for (const double z : kShelves) b.Box({x0, y0, z}, {5.59, y1, z + 0.026}, Surface::kOak, oak);
  const Vector3f spines[] = {{0.40f, 0.09f, 0.06f}, {0.07f, 0.14f, 0.22f}, {0.55f, 0.50f, 0.40f},
                             {0.12f, 0.20f, 0.13f}, {0.60f, 0.36f, 0.10f}, {0.66f, 0.63f, 0.57f},
                             {0.09f, 0.09f, 0.10f}, {0.33f, 0.20f, 0.24f}, {0.20f, 0.33f, 0.36f},
                             {0.48f, 0.24f, 0.13f}};
  for (int shelf = 0; shelf < 5; ++shelf) {
    const double z = kShelves[shelf] + 0.026;
    double y = y1 - 0.05;
    for (int i = 0; i < 26 && y > y0 + 0.07; ++i) {
      const int key = shelf * 64 + i;
      const double thick = 0.02 + 0.026 * Unit(key, 1);
      if (Unit(key, 2) < 0.10 && i > 2) {  // room for a thing between the books
        const double r = 0.05;
        if (y - 2.6 * r < y0 + 0.05) break;
        const Vector3f glaze =
            Unit(key, 9) < 0.5f ? Vector3f(0.58f, 0.55f, 0.50f) : Vector3f(0.12f, 0.24f, 0.27f);
        b.Cone(MakeEllipsoid({5.43, y - 1.3 * r, z + 0.075}, Eigen::Matrix3d::Identity(), {r, r, 0.075}),
               Surface::kCeramic, glaze);
        y -= 2.6 * r;
        continue;
      }
      const double tall = 0.19 + 0.11 * Unit(key, 3);
      const double deep = 0.15 + 0.06 * Unit(key, 4);
      const Vector3f color = (0.75f + 0.5f * Unit(key, 5)) * spines[static_cast<int>(Unit(key, 6) * 9.99f)];
      b.Box({5.55 - deep, y - thick, z}, {5.55, y, z + tall}, Surface::kPaint, color);
      y -= thick + 0.002;
    }
  }
}

void AddSkirting(Builder& b) {
  b.Box({plan::kBackX - 0.016, plan::kRightY, 0}, {plan::kBackX, plan::kLeftY, 0.12}, Surface::kPaint,
        kWhite);
  b.Box({plan::kFrontX, plan::kLeftY - 0.016, 0}, {plan::kBackX, plan::kLeftY, 0.12}, Surface::kPaint,
        kWhite);
  b.Box({plan::kFrontX, plan::kRightY, 0}, {plan::kBackX, plan::kRightY + 0.016, 0.12}, Surface::kPaint,
        kWhite);
}

}  // namespace

std::vector<Solid> Furniture() {
  Builder b;
  AddSkirting(b);
  AddWindow(b);
  AddBench(b);
  AddPlant(b);
  AddSideboard(b);
  AddBookshelf(b);
  return b.Take();
}

}  // namespace mixstage
