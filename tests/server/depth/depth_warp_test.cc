// SPDX-License-Identifier: Apache-2.0
#include "server/depth/depth_warp.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>

namespace mixstage {
namespace {

// A ToF camera beside a colour camera, both with strong lenses, turned and shifted against each other.
Rig TwoCameras() {
  Rig rig;
  rig.color = {.width = 640,
               .height = 480,
               .fx = 690,
               .fy = 685,
               .cx = 325,
               .cy = 236,
               .k1 = -0.2,
               .k2 = 0.06,
               .p1 = 0.0005,
               .p2 = -0.0004};
  DepthCamera depth;
  depth.camera = {
      .width = 176, .height = 144, .fx = 200, .fy = 200.5, .cx = 89, .cy = 70, .k1 = -0.25, .k2 = 0.1};
  depth.unit_m = 0.00025;
  depth.unambiguous_range_m = 7.4948;
  depth.range_error = {{1, 2, 3, 4, 7}, {0.01, -0.015, 0.012, -0.01, 0.008}};
  rig.depth = depth;
  rig.T_color_depth.linear() = (Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY()) *
                                Eigen::AngleAxisd(-0.015, Eigen::Vector3d::UnitX()))
                                   .toRotationMatrix();
  rig.T_color_depth.translation() = Eigen::Vector3d(0.09, -0.02, 0.01);
  return rig;
}

// In the depth camera's frame: a slanted wall at about 4.5 m and a box before it.
struct WallAndBox {
  Eigen::Vector3d low{-0.35, -0.6, 2.6}, high{0.4, 1.1, 2.9};
  Eigen::Vector3d wall_normal = Eigen::Vector3d(0.08, -0.05, 1).normalized();
  double wall_offset = 4.5;
  bool with_box = true;

  // Nearest t > 0 with origin + t direction on a surface.
  [[nodiscard]] double Hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
    const double wall = (wall_offset - wall_normal.dot(origin)) / wall_normal.dot(direction);
    if (!with_box) return wall;
    double enter = 0, leave = std::numeric_limits<double>::infinity();
    for (int k = 0; k < 3; ++k) {
      const double a = (low[k] - origin[k]) / direction[k];
      const double b = (high[k] - origin[k]) / direction[k];
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    return enter < leave && enter > 0 ? std::min(enter, wall) : wall;
  }
};

// What the ToF camera reports: mean range over n x n rays a pixel (n > 1 mixes surfaces at steps), noise_m on
// it.
cv::Mat1w Reported(const Rig& rig, const WallAndBox& scene, int n = 1, double noise_m = 0) {
  const DepthCamera& depth = *rig.depth;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 1);
  cv::Mat1w raw(depth.camera.height, depth.camera.width);
  for (int v = 0; v < raw.rows; ++v) {
    for (int u = 0; u < raw.cols; ++u) {
      double range = 0;
      for (int k = 0; k < n * n; ++k) {
        const Eigen::Vector2d pixel(u + (k % n + 0.5) / n - 0.5, v + (k / n + 0.5) / n - 0.5);
        const Eigen::Vector3d ray = depth.camera.Unproject(pixel)->homogeneous();
        range += scene.Hit(Eigen::Vector3d::Zero(), ray) * ray.norm() / (n * n);
      }
      range += depth.range_error.At(range) + noise_m * noise(random);
      raw(v, u) = static_cast<std::uint16_t>(std::lround(range / depth.unit_m));
    }
  }
  return raw;
}

struct Truth {
  cv::Mat1f depth_m;        // what the colour camera sees
  cv::Mat1b hidden;         // 255: a surface that the depth camera does not see
  cv::Mat1b in_depth_view;  // 255: well inside the depth camera's picture
};

Truth TruthOf(const Rig& rig, const WallAndBox& scene) {
  const cv::Size size(rig.color.width, rig.color.height);
  Truth truth{cv::Mat1f(size, 0.0f), cv::Mat1b(size, 0), cv::Mat1b(size, 0)};
  const RigidTransform T_depth_color = rig.T_color_depth.inverse();
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const Eigen::Vector3d ray = rig.color.Unproject({u, v})->homogeneous();
      const Eigen::Vector3d direction = T_depth_color.linear() * ray;
      const Eigen::Vector3d origin = T_depth_color.translation();
      const double t = scene.Hit(origin, direction);
      truth.depth_m(v, u) = static_cast<float>(t);
      const Eigen::Vector3d p = origin + t * direction;
      truth.hidden(v, u) = scene.Hit(Eigen::Vector3d::Zero(), p) < 1 - 1e-6 ? 255 : 0;
      const auto pixel = rig.depth->camera.Project(p);
      const bool inside = pixel && pixel->x() > 1 && pixel->y() > 1 &&
                          pixel->x() < rig.depth->camera.width - 2 &&
                          pixel->y() < rig.depth->camera.height - 2;
      truth.in_depth_view(v, u) = inside ? 255 : 0;
    }
  }
  return truth;
}

cv::Mat1f Warp(const Rig& rig, const cv::Mat1w& raw, const cv::Mat1w& amplitude = {}) {
  auto warp = DepthWarp::Create(rig, {});
  EXPECT_TRUE(warp) << warp.error().message;
  cv::Mat1f depth_m(rig.color.height, rig.color.width, -1.0f);
  const Status ok = warp->Run(View(raw), View(amplitude), View(depth_m));
  EXPECT_TRUE(ok) << ok.error().message;
  return depth_m;
}

TEST(DepthWarp, EveryKnownPixelHasTheTruthAndHiddenOnesAreUnknown) {
  const Rig rig = TwoCameras();
  const WallAndBox scene;
  const Truth truth = TruthOf(rig, scene);
  const cv::Mat1f depth_m = Warp(rig, Reported(rig, scene));
  int visible = 0, known = 0, hidden = 0, on_box = 0;
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      const float z = depth_m(v, u);
      const float t = truth.depth_m(v, u);
      // Rounding of counts; and where box or wall is not the surface that the pixel shows, it would be
      // decimetres.
      if (z > 0) {
        ASSERT_NEAR(z, t, 0.002) << u << "," << v;
      }
      if (truth.in_depth_view(v, u) == 0) continue;
      if (truth.hidden(v, u) != 0) {
        ++hidden;
        EXPECT_EQ(z, 0) << u << "," << v << ": the depth camera does not see this";
        continue;
      }
      ++visible;
      known += z > 0;
      on_box += z > 0 && t < 3.2f;
    }
  }
  EXPECT_GT(hidden, 1500) << "the strip beside the box";
  EXPECT_GT(known, 0.95 * visible);
  EXPECT_GT(on_box, 20'000);
}

TEST(DepthWarp, PlaneAloneHasNoHole) {
  const Rig rig = TwoCameras();
  WallAndBox scene;
  scene.with_box = false;
  const Truth truth = TruthOf(rig, scene);
  const cv::Mat1f depth_m = Warp(rig, Reported(rig, scene));
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      if (truth.in_depth_view(v, u) != 0) {
        ASSERT_NEAR(depth_m(v, u), truth.depth_m(v, u), 0.001) << u << "," << v;
      }
    }
  }
}

TEST(DepthWarp, MixedPixelsHangNoSheetBetweenBoxAndWall) {
  const Rig rig = TwoCameras();
  const WallAndBox scene;
  const Truth truth = TruthOf(rig, scene);
  const cv::Mat1f depth_m = Warp(rig, Reported(rig, scene, /*n=*/4));
  int between = 0, known = 0;
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      if (depth_m(v, u) == 0) continue;
      ++known;
      // A pixel mixed by less than a step's threshold stays in its surface.
      between += std::abs(depth_m(v, u) - truth.depth_m(v, u)) > 0.12f;
    }
  }
  EXPECT_GT(known, 150'000);
  EXPECT_LT(between, known / 2000);
}

TEST(DepthWarp, NoiseTearsNeitherWallNorBox) {
  const Rig rig = TwoCameras();
  const WallAndBox scene;
  const Truth truth = TruthOf(rig, scene);
  const cv::Mat1w raw = Reported(rig, scene, 1, /*noise_m=*/0.05);
  const cv::Mat1f depth_m = Warp(rig, raw);
  int visible = 0, known = 0, wrong = 0, shine_through = 0;
  double squared = 0;
  for (int v = 0; v < depth_m.rows; ++v) {
    for (int u = 0; u < depth_m.cols; ++u) {
      if (truth.in_depth_view(v, u) == 0) continue;
      const float error = depth_m(v, u) - truth.depth_m(v, u);
      if (truth.hidden(v, u) != 0) {
        shine_through += depth_m(v, u) > 0;
        continue;
      }
      ++visible;
      if (depth_m(v, u) == 0) continue;
      ++known;
      wrong += std::abs(error) > 0.5f;
      squared += error * error;
    }
  }
  EXPECT_GT(known, 0.94 * visible);
  // No sheet between box and wall: noise moves a corner by parallax, and the outline with it by less than a
  // pixel.
  EXPECT_LT(wrong, 20);
  EXPECT_LT(shine_through, 60);
  // Interpolation between noisy corners has less noise than they have.
  EXPECT_LT(std::sqrt(squared / known), 0.05);
  // The same picture gives the same bytes, whatever came before.
  auto warp = *DepthWarp::Create(rig, {});
  cv::Mat1f again(depth_m.size());
  for (const cv::Mat1w& picture : {Reported(rig, scene), cv::Mat1w(raw.size(), std::uint16_t{0}), raw}) {
    ASSERT_TRUE(warp.Run(View(picture), {}, View(again)));
  }
  EXPECT_EQ(cv::norm(depth_m, again, cv::NORM_INF), 0);
}

TEST(DepthWarp, NothingNearerThanTheNearPlaneIsDrawn) {
  Rig rig = TwoCameras();
  // The colour camera stands 1.0 m in front of the depth camera: what the latter sees at 1.05 m is at 5 cm
  // there.
  rig.T_color_depth = RigidTransform::Identity();
  rig.T_color_depth.translation().z() = -1.0;
  rig.depth->range_error = {};
  cv::Mat1w raw(144, 176);
  for (int v = 0; v < raw.rows; ++v) {
    for (int u = 0; u < raw.cols; ++u) {
      const double length = rig.depth->camera.Unproject({u, v})->homogeneous().norm();
      raw(v, u) = static_cast<std::uint16_t>(std::lround((u < 88 ? 1.05 : 3.0) * length / rig.depth->unit_m));
    }
  }
  const cv::Mat1f depth_m = Warp(rig, raw);
  int known = 0;
  for (const float z : depth_m) {
    EXPECT_TRUE(z == 0 || std::abs(z - 2.0f) < 0.002f) << z;
    known += z > 0;
  }
  EXPECT_GT(known, 10'000);
}

TEST(DepthWarp, AnyBytesAreHarmless) {
  const Rig rig = TwoCameras();
  std::mt19937 random(7);
  cv::Mat1w raw(144, 176), amplitude(144, 176);
  for (int round = 0; round < 4; ++round) {
    for (auto& count : raw) count = static_cast<std::uint16_t>(random() >> (round * 2));
    for (auto& a : amplitude) a = static_cast<std::uint16_t>(random() >> (round * 3));
    const cv::Mat1f with_amplitude = Warp(rig, raw, amplitude);
    for (const float z : with_amplitude) ASSERT_TRUE(z >= 0 && z < 20.5f);
    const cv::Mat1f without = Warp(rig, raw);
    for (const float z : without) ASSERT_TRUE(z >= 0 && z < 20.5f);
  }
}

TEST(DepthWarp, TheSmallestPicturesAreHarmless) {
  for (const cv::Size size :
       {cv::Size(1, 1), cv::Size(2, 1), cv::Size(1, 3), cv::Size(2, 2), cv::Size(9, 2)}) {
    Rig rig = TwoCameras();
    rig.color = {.width = 3, .height = 2, .fx = 5, .fy = 5, .cx = 1, .cy = 0.5};
    rig.depth->camera = {.width = size.width, .height = size.height, .fx = 5, .fy = 5, .cx = 0, .cy = 0};
    const cv::Mat1f depth_m =
        Warp(rig, cv::Mat1w(size, std::uint16_t{8000}), cv::Mat1w(size, std::uint16_t{50}));
    for (const float z : depth_m) EXPECT_TRUE(z >= 0 && z < 2.2f);
  }
}

Rig Registered(int width, int height) {
  Rig rig = AssumedRig(width, height, 0.0002);
  EXPECT_TRUE(rig.registered);
  return rig;
}

TEST(DepthWarp, RegisteredCountsBecomeMetres) {
  const Rig rig = Registered(64, 48);
  cv::Mat1w raw(48, 64, std::uint16_t{10'000});
  raw(3, 5) = 0;
  raw(4, 6) = 65535;
  const cv::Mat1f depth_m = Warp(rig, raw);
  EXPECT_FLOAT_EQ(depth_m(10, 10), 2.0f);
  EXPECT_EQ(depth_m(3, 5), 0);
  EXPECT_FLOAT_EQ(depth_m(4, 6), 13.107f);
}

TEST(DepthWarp, RegisteredDepthOfAnotherSizeIsSampledInPlace) {
  const Rig rig = Registered(64, 48);
  // A half, and something that is the same shape within a percent.
  for (const cv::Size size : {cv::Size(32, 24), cv::Size(63, 47), cv::Size(128, 96)}) {
    cv::Mat1w raw(size);
    for (int v = 0; v < raw.rows; ++v) {
      for (int u = 0; u < raw.cols; ++u) raw(v, u) = static_cast<std::uint16_t>(1000 + 100 * u + v);
    }
    const cv::Mat1f depth_m = Warp(rig, raw);
    for (int v = 0; v < 48; ++v) {
      for (int u = 0; u < 64; ++u) {
        const int column = static_cast<int>((u + 0.5) * size.width / 64);
        const int row = static_cast<int>((v + 0.5) * size.height / 48);
        EXPECT_FLOAT_EQ(depth_m(v, u), static_cast<float>(0.0002 * (1000 + 100 * column + row)));
      }
    }
  }
}

std::string Refused(const Rig& rig, cv::Size depth, cv::Size color, cv::Size amplitude = {}) {
  auto warp = DepthWarp::Create(rig, {});
  if (!warp) return warp.error().message;
  const cv::Mat1w raw(depth, std::uint16_t{0});
  const cv::Mat1w light(amplitude, std::uint16_t{0});
  cv::Mat1f out(color);
  const Status ok = warp->Run(View(raw), View(light), View(out));
  return ok ? "" : ok.error().message;
}

TEST(DepthWarp, SaysWhatIsWrongWithRigOrPicture) {
  const Rig rig = TwoCameras();
  EXPECT_EQ(Refused(rig, {176, 144}, {640, 480}), "");
  EXPECT_NE(Refused(rig, {640, 480}, {640, 480}).find("depth picture is 640x480"), std::string::npos);
  EXPECT_NE(Refused(rig, {176, 144}, {1024, 768}).find("colour picture is 1024x768"), std::string::npos);
  EXPECT_NE(Refused(rig, {176, 144}, {640, 480}, {88, 72}).find("amplitude picture is 88x72"),
            std::string::npos);
  EXPECT_NE(Refused(Registered(64, 48), {64, 64}, {64, 48}).find("shape"), std::string::npos);
  EXPECT_NE(Refused(Registered(64, 48), {0, 0}, {64, 48}).find("0x0"), std::string::npos);

  Rig bad = rig;
  bad.depth.reset();
  EXPECT_NE(Refused(bad, {}, {}).find("cameras.depth is missing"), std::string::npos);
  bad = rig;
  bad.color.fy = -1;
  EXPECT_NE(Refused(bad, {}, {}).find("cameras.color"), std::string::npos);
  bad = rig;
  bad.depth->camera.fx = 3;
  EXPECT_NE(Refused(bad, {}, {}).find("cameras.depth.fx"), std::string::npos);
  bad = rig;
  bad.T_color_depth.translation().x() = std::nan("");
  EXPECT_NE(Refused(bad, {}, {}).find("T_color_depth"), std::string::npos);
  EXPECT_FALSE(DepthWarp::Create(rig, {.near_m = 0}));
  EXPECT_FALSE(DepthWarp::Create(rig, {.edge_sigmas = 0}));
}

}  // namespace
}  // namespace mixstage
