// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "proto/synthetic/figure_kernels.h"
#include "proto/synthetic/figure_view.h"
#include "proto/synthetic/noise_tape.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/room_plate.h"

namespace mixstage {
namespace {

struct Plane {
  alignas(64) float at[kTile * kTile] = {};
};

TEST(FigureKernels, RasterAgreesWithTheScalarIntersectionOfEveryRay) {
  const Rig rig = SyntheticRig();
  const RigidTransform T_world_color = SyntheticTWorldColor(rig);
  const Walk walk;
  Figure figure;
  PoseFigure(walk.At(13.0), figure);
  FigureView view;
  ViewFigure(figure, rig.color, T_world_color, 2, view);
  int hits = 0;
  for (int v0 = view.v0 / kTile * kTile; v0 <= view.v1; v0 += kTile) {
    const int u0 = (view.u0 + view.u1) / 2 / kTile * kTile;
    Plane ray[3];
    Plane z;
    std::uint8_t list[Figure::kMaxParts];
    for (int i = 0; i < view.count; ++i) list[i] = static_cast<std::uint8_t>(i);
    for (int k = 0; k < kTile * kTile; ++k) {
      const auto n = rig.color.Unproject({u0 + k % kTile, std::min(v0 + k / kTile, 767)});
      ASSERT_TRUE(n.has_value());
      const Eigen::Vector3d r = T_world_color.linear() * Eigen::Vector3d(n->x(), n->y(), 1);
      for (int c = 0; c < 3; ++c) ray[c].at[k] = static_cast<float>(r[c]);
    }
    BodyTile tile{};
    for (int c = 0; c < 3; ++c) tile.ray[c] = ray[c].at;
    tile.z = z.at;
    RasterBody(view.parts.data(), list, view.count, u0, v0, tile);
    for (int k = 0; k < kTile * kTile; ++k) {
      const Eigen::Vector3d r(ray[0].at[k], ray[1].at[k], ray[2].at[k]);
      double exact = INFINITY;
      for (int i = 0; i < figure.count; ++i) {
        const auto t =
            figure.parts[static_cast<std::size_t>(i)].cone.Intersect(T_world_color.translation(), r, 0);
        if (t) exact = std::min(exact, *t);
      }
      const bool hit = z.at[k] < kNoDepth;
      if (hit && std::isfinite(exact)) {
        // Float against double; a graze can be off by a part's own thickness, so a few millimetres there.
        EXPECT_NEAR(z.at[k], exact, 2e-3);
        ++hits;
      }
      // A ray that only one of the two sees must be a graze: exact hits of a body a hair thicker or thinner.
      if (hit != std::isfinite(exact)) {
        const Eigen::Vector3d across = r.unitOrthogonal() * 1e-5;
        bool near_outline = false;
        for (const Eigen::Vector3d& nudge :
             {across, Eigen::Vector3d(-across), Eigen::Vector3d(r.normalized().cross(across)),
              Eigen::Vector3d(-r.normalized().cross(across))}) {
          bool other = false;
          for (int i = 0; i < figure.count; ++i) {
            other |= figure.parts[static_cast<std::size_t>(i)]
                         .cone.Intersect(T_world_color.translation(), r + nudge, 0)
                         .has_value();
          }
          near_outline |= other == hit;
        }
        EXPECT_TRUE(near_outline) << u0 + k % kTile << " " << v0 + k / kTile;
      }
    }
  }
  EXPECT_GT(hits, 1000);
}

TEST(FigureKernels, CoverageOfAnOutlinePixelIsTheShareOfItsAreaThatTheBodyFills) {
  const Rig rig = SyntheticRig();
  const RigidTransform T_world_color = SyntheticTWorldColor(rig);
  Figure figure;
  PoseFigure(Walk().At(13.0), figure);
  FigureView view;
  ViewFigure(figure, rig.color, T_world_color, 2, view);
  std::uint8_t list[Figure::kMaxParts];
  for (int i = 0; i < view.count; ++i) list[i] = static_cast<std::uint8_t>(i);
  auto ray_of = [&](double u, double v) {
    const auto n = rig.color.Unproject({u, v});
    return Eigen::Vector3d(T_world_color.linear() * Eigen::Vector3d(n->x(), n->y(), 1));
  };
  auto meets = [&](const Eigen::Vector3d& ray) {
    for (int i = 0; i < figure.count; ++i) {
      const RoundCone& cone = figure.parts[static_cast<std::size_t>(i)].cone;
      if (cone.Intersect(T_world_color.translation(), ray, 0)) return true;
    }
    return false;
  };
  float plane[8] = {};
  BodyTile tile{};
  tile.z = &plane[0];
  tile.coverage = &plane[1];
  for (int c = 0; c < 3; ++c) {
    tile.normal[c] = &plane[2 + c];
    tile.albedo[c] = &plane[5 + c];
  }
  int outline = 0;
  double error = 0;
  for (int v = view.v0; v <= view.v1; v += 9) {
    for (int u = view.u0; u <= view.u1; ++u) {
      if (meets(ray_of(u - 0.5, v)) == meets(ray_of(u + 0.5, v))) continue;
      double covered = 0;
      for (int k = 0; k < 256; ++k) {
        covered +=
            meets(ray_of(u + (k % 16 + 0.5) / 16 - 0.5, v + (k / 16 + 0.5) / 16 - 0.5)) ? 1.0 / 256 : 0;
      }
      const Eigen::Vector3f r = ray_of(u, v).cast<float>();
      const Eigen::Vector3f ru = (ray_of(u + 1, v) - ray_of(u, v)).cast<float>();
      const Eigen::Vector3f rv = (ray_of(u, v + 1) - ray_of(u, v)).cast<float>();
      SupersampleBody(view.parts.data(), list, view.count, u, v, 0, r.data(), ru.data(), rv.data(), tile);
      EXPECT_NEAR(plane[1], covered, 0.13) << u << " " << v;  // 16 rays against 256
      error += std::abs(plane[1] - covered);
      ++outline;
    }
  }
  ASSERT_GT(outline, 100);
  EXPECT_LT(error / outline, 0.03);
}

TEST(FigureKernels, NoiseAgreesWithTheScalarLoopOnAllWidths) {
  std::mt19937 random(5);
  std::vector<std::int16_t> base(80);
  std::vector<std::int8_t> noise(80);
  for (std::size_t i = 0; i < base.size(); ++i) {
    base[i] = static_cast<std::int16_t>(random() % (255 * 64 + 1));
    noise[i] = static_cast<std::int8_t>(static_cast<int>(random() % 255) - 127);
  }
  for (int width = 0; width <= 67; ++width) {
    for (const int slope : {0, 1}) {
      std::vector<std::uint8_t> fast(80, 99);
      std::vector<std::uint8_t> plain(80, 99);
      AddNoise(base.data() + 3, noise.data() + 1, width, 66, slope, fast.data());
      AddNoiseScalar(base.data() + 3, noise.data() + 1, width, 66, slope, plain.data());
      EXPECT_EQ(fast, plain) << width;
    }
  }
}

TEST(FigureKernels, LampSharesAreTheProductOfWhatEachCasterLeaves) {
  Walk walk;
  Figure figure;
  PoseFigure(walk.At(8.0), figure);
  Casters casters;
  CastersOf(figure, casters);
  ASSERT_GT(casters.count, 8);
  BodyLight light{};
  light.window_lamp = {{3.8f, 2.6f, 1.5f}, 1.0f};
  light.softbox_lamp = {{2.3f, -0.9f, 2.6f}, 0.3f};
  constexpr int kCount = 48;
  std::vector<float> p[3], n[3];
  for (int c = 0; c < 3; ++c) {
    p[c].resize(kCount);
    n[c].assign(kCount, c == 2 ? 1.f : 0.f);
  }
  const Eigen::Vector2d body = walk.At(8.0).body;
  for (int i = 0; i < kCount; ++i) {
    p[0][static_cast<std::size_t>(i)] = static_cast<float>(body.x()) + 0.05f * static_cast<float>(i % 8);
    p[1][static_cast<std::size_t>(i)] =
        static_cast<float>(body.y()) + 0.12f * static_cast<float>(i / 8) - 0.3f;
  }
  std::vector<float> window(kCount), softbox(kCount), ambient(kCount);
  OccludeRoom(light, casters.casters.data(), casters.count,
              {{p[0].data(), p[1].data(), p[2].data()},
               {n[0].data(), n[1].data(), n[2].data()},
               kCount,
               window.data(),
               softbox.data(),
               ambient.data()});
  float darkest = 1;
  for (std::size_t i = 0; i < kCount; ++i) {
    float plain = 1;
    const float at[3] = {p[0][i], p[1][i], p[2][i]};
    for (int k = 0; k < casters.count; ++k) {
      const Caster& caster = casters.casters[static_cast<std::size_t>(k)];
      plain *= 1 - OccludedShare(light.softbox_lamp, caster, caster.room_radius, 0, at);
    }
    EXPECT_NEAR(softbox[i], plain, 0.01);  // the kernel's reciprocals have 12 bits
    EXPECT_GE(ambient[i], 0);
    EXPECT_LE(ambient[i], 1);
    darkest = std::min(darkest, plain);
  }
  EXPECT_LT(darkest, 0.3f);
}

TEST(FigureKernels, ComposedPixelsFollowTheCamerasResponse) {
  std::vector<std::uint16_t> layers[3];
  for (auto& layer : layers) layer.assign(3 * kTile * kTile, 0);
  for (int k = 0; k < kTile * kTile; ++k) {
    const auto value = static_cast<std::uint16_t>(k * 24);  // 0 .. 1.5
    for (int c = 0; c < 3; ++c) layers[2][static_cast<std::size_t>(c * kTile * kTile + k)] = value;
  }
  std::vector<std::int16_t> y(kTile * kTile), cb(kTile * kTile / 4), cr(kTile * kTile / 4);
  ComposeTile tile{};
  for (int k = 0; k < 3; ++k) tile.layer[k] = layers[k].data();
  tile.y = y.data();
  tile.cb = cb.data();
  tile.cr = cr.data();
  tile.y_stride = kTile;
  tile.chroma_stride = kTile / 2;
  Compose(tile);
  for (int k = 0; k < kTile * kTile; ++k) {
    const float linear = static_cast<float>(k * 24) / kLayerScale;
    EXPECT_NEAR(y[static_cast<std::size_t>(k)] / 64.0, 255 * CameraResponse(linear), 0.6) << linear;
  }
  for (std::size_t i = 0; i < cb.size(); ++i) {
    EXPECT_NEAR(cb[i], 128 * 64, 8);
    EXPECT_NEAR(cr[i], 128 * 64, 8);
  }
}

TEST(NoiseTape, IsGaussianOfUnitVarianceAndTheSameForTheSameSeed) {
  const NoiseTape tape(11);
  const NoiseTape same(11);
  const NoiseTape other(12);
  double sum = 0;
  double squares = 0;
  int equal = 0;
  for (int i = 0; i < NoiseTape::kMaxRow; ++i) {
    const float n = tape.Normal(3, 4)[i];
    sum += n;
    squares += n * n;
    EXPECT_EQ(n, same.Normal(3, 4)[i]);
    equal += n == other.Normal(3, 4)[i] ? 1 : 0;
  }
  EXPECT_NEAR(sum / NoiseTape::kMaxRow, 0, 0.05);
  EXPECT_NEAR(squares / NoiseTape::kMaxRow, 1, 0.06);
  EXPECT_LT(equal, 10);
}

}  // namespace
}  // namespace mixstage
