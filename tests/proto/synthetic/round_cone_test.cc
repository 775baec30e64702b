// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/round_cone.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mixstage {
namespace {

using Eigen::Vector3d;

// Distance to the hull of two spheres, by sampling the spheres between them: slow and plain.
double PlainDistance(const Vector3d& a, const Vector3d& b, double ra, double rb, const Vector3d& p) {
  double best = INFINITY;
  for (int i = 0; i <= 4000; ++i) {
    const double t = i / 4000.0;
    best = std::min(best, (p - (a + t * (b - a))).norm() - (ra + t * (rb - ra)));
  }
  return best;
}

TEST(RoundCone, RayMeetsTheHullOfItsTwoSpheres) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  int met = 0;
  for (int i = 0; i < 300; ++i) {
    const Vector3d a(0.3 * unit(random), 0.3 * unit(random), 0.3 * unit(random));
    const Vector3d b(0.3 * unit(random), 0.3 * unit(random), 0.3 * unit(random));
    const double ra = 0.12 + 0.08 * unit(random);
    const double rb =
        std::min(std::max(0.03, ra + 0.5 * (b - a).norm() * unit(random)), ra + 0.9 * (b - a).norm());
    if (std::abs(ra - rb) > 0.9 * (b - a).norm()) continue;
    const RoundCone cone = MakeRoundCone(a, b, ra, rb);
    const Vector3d origin = 2 * Vector3d(unit(random), unit(random), unit(random) + 2).normalized();
    const Vector3d direction =
        1.7 * (Vector3d(0.2 * unit(random), 0.2 * unit(random), 0.2 * unit(random)) - origin);
    const auto t = cone.Intersect(origin, direction, 0);
    // March: the first place where the plain distance vanishes.
    double s = 0;
    double nearest = INFINITY;
    for (int step = 0; step < 400 && s * direction.norm() < 5; ++step) {
      const double d = PlainDistance(a, b, ra, rb, origin + s * direction);
      nearest = std::min(nearest, d);
      if (d < 1e-6) break;
      s += d / direction.norm();
    }
    if (nearest > 1e-4) {
      EXPECT_FALSE(t.has_value());
    } else if (nearest < 1e-6) {
      ASSERT_TRUE(t.has_value());
      EXPECT_NEAR(*t, s, 1e-4);
      ++met;
    }
  }
  EXPECT_GT(met, 50);
}

TEST(RoundCone, NormalIsTheGradientOfAStretchedBody) {
  const RoundCone cone = MakeRoundCone({0, 0, 0}, {0.1, 0, 0.4}, 0.12, 0.08, Vector3d::UnitY(), 1.4, 0.8);
  for (int i = 0; i < 40; ++i) {
    const Vector3d origin(2 * std::cos(0.7 * i), 2 * std::sin(0.7 * i), 0.2 + 0.01 * i);
    const Vector3d direction = (Vector3d(0.05, 0, 0.2) - origin).normalized();
    const auto t = cone.Intersect(origin, direction, 0);
    ASSERT_TRUE(t.has_value());
    const Vector3d p = origin + *t * direction;
    const Vector3d n = cone.Normal(p);
    EXPECT_NEAR(n.norm(), 1, 1e-9);
    // Points moved along the surface stay on it to second order: a parallel ray meets it on the tangent
    // plane.
    for (const Vector3d& side : {Vector3d(n.unitOrthogonal()), Vector3d(n.cross(n.unitOrthogonal()))}) {
      const Vector3d moved = p + 1e-4 * side;
      const auto back = cone.Intersect(moved + n, -n, 0);
      ASSERT_TRUE(back.has_value());
      EXPECT_NEAR(*back, 1, 1e-5);
    }
  }
}

TEST(RoundCone, BoundsHoldTheBody) {
  const RoundCone cone =
      MakeRoundCone({0.1, 0.2, 0.3}, {0.5, -0.1, 0.6}, 0.1, 0.05, Vector3d::UnitZ(), 1.5, 0.5);
  const Eigen::AlignedBox3d box = cone.Bounds();
  for (int i = 0; i < 200; ++i) {
    const Vector3d direction(std::sin(1.3 * i), std::cos(2.1 * i), std::sin(0.9 * i + 1));
    const Vector3d target =
        box.center() + 0.5 * Vector3d(std::sin(3.0 * i), std::cos(5.0 * i), 0).cwiseProduct(box.sizes());
    const Vector3d origin = target - 3 * direction.normalized();
    if (const auto t = cone.Intersect(origin, direction.normalized(), 0)) {
      EXPECT_LT(box.exteriorDistance(origin + *t * direction.normalized()), 1e-9);
    }
  }
}

}  // namespace
}  // namespace mixstage
