// SPDX-License-Identifier: Apache-2.0
//
// From noisy range pictures of a room known by formula to its planes and its mesh.
#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "server/environment/dense_surface.h"
#include "server/environment/depth_fusion.h"
#include "server/environment/edge_placement.h"
#include "server/environment/room_planes.h"
#include "server/environment/surface_fit.h"
#include "server/environment/surface_mesh.h"
#include "server/environment/sweep_layout.h"
#include "tests/support/box_room.h"

namespace mixstage {
namespace {

constexpr double kSigma_m = 0.03;

struct Scanned {
  BoxRoom room;
  std::vector<RigidTransform> poses;  // T_world_color
  PanoramaGrid grid;
  FusedDepth fused;
  SurfaceNodes nodes;
  std::vector<GrownPlane> planes;
  DenseSurface dense;
  SurfaceMesh mesh;
};

const Scanned& ScannedRoom() {
  static const Scanned scanned = [] {
    const BoxRoom room;
    const Rig rig = BoxRoomRig();
    const RangeCamera camera = RangeCamera::Of(rig);
    std::mt19937 random(7);
    std::vector<RigidTransform> poses;
    for (const double elevation : {-0.35, 0.0, 0.35})
      for (const double azimuth : {-0.5, -0.15, 0.2, 0.55})
        poses.push_back(
            LookTo({1 + 0.05 * std::cos(azimuth), 1.5 + 0.05 * std::sin(azimuth), 1.4}, azimuth, elevation));
    constexpr int kNodeStep = 2;
    const PanoramaGrid grid(Coarser(LayOutPanorama(rig.color, poses, 3 * kNodeStep), 3));
    EXPECT_EQ(NodeStep(grid, camera.pitch_rad), kNodeStep);
    std::vector<PanoramaPatch> patches;
    for (const RigidTransform& T_world_color : poses) {
      const RigidTransform T_world_depth = T_world_color * camera.T_color_depth;
      patches.push_back(SeeFromCenter(SeeBoxRoom(room, camera, T_world_depth, kSigma_m, random), camera,
                                      T_world_depth, grid));
    }
    Scanned s{room, poses, grid, Fuse(patches, grid), {}, {}, {}, {}};
    s.nodes = MakeNodes(s.fused, grid, kNodeStep);
    FitPlanes(s.nodes);
    s.planes = GrowPlanes(s.nodes, {});
    FitPlanes(s.nodes);
    FillNodes(s.nodes, std::vector<std::uint8_t>(s.nodes.ray.size(), 1));
    s.dense = MakeDense(s.nodes, s.fused, grid);
    s.mesh = MakeSurfaceMesh(s.dense, s.nodes, grid, {});
    return s;
  }();
  return scanned;
}

TEST(RoomPlanes, AreExactToMillimetresOutOfThreeCentimetresOfNoise) {
  const Scanned& s = ScannedRoom();
  const Eigen::Vector3d c = s.grid.panorama().center;
  int found = 0;
  for (const auto& [normal, distance] :
       {std::pair{Eigen::Vector3d(0, 0, -1), c.z()}, std::pair{Eigen::Vector3d(0, 0, 1), 2.6 - c.z()},
        std::pair{Eigen::Vector3d(1, 0, 0), 5 - c.x()}}) {
    for (const GrownPlane& p : s.planes) {
      if (p.m.normalized().dot(normal) < 0.9999) continue;
      if (std::abs(1 / p.m.norm() - distance) < 0.003) ++found;
    }
  }
  EXPECT_EQ(found, 3);
}

TEST(DenseSurface, LosesTheNoiseAndKeepsTheEdges) {
  const Scanned& s = ScannedRoom();
  std::vector<double> errors;
  int edge_wrong = 0, edge = 0;
  auto truth = [&](int x, int y) {
    return s.room.Range(s.grid.panorama().center, s.grid.Ray(x, y).cast<double>());
  };
  constexpr int kMargin = 6;
  for (int y = kMargin; y + kMargin < s.grid.height(); y += 3) {
    for (int x = kMargin; x + kMargin < s.grid.width(); x += 3) {
      if (s.fused.inverse_range(y, x) == 0) continue;
      const double r = truth(x, y), error = std::abs(1 / s.dense.inverse_range(y, x) - r);
      double step = 0;
      for (const auto& [dx, dy] :
           {std::pair{kMargin, 0}, std::pair{-kMargin, 0}, std::pair{0, kMargin}, std::pair{0, -kMargin}})
        step = std::max(step, std::abs(truth(x + dx, y + dy) - r));
      if (step < 0.3) {
        errors.push_back(error);
      } else {
        ++edge;
        edge_wrong += error > 0.15;
      }
    }
  }
  ASSERT_GT(errors.size(), 1000u);
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.001);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.006);
  // Within six pixels of an edge at most every eighth pixel is on the wrong side: it is displaced by less
  // than one.
  EXPECT_LT(edge_wrong, edge / 8) << edge;
}

// What the colour camera sees of the room: a grey block before brighter walls.
cv::Mat3b PictureOf(const BoxRoom& room, const PinholeCamera& camera, const RigidTransform& T_world_color) {
  cv::Mat3b picture(camera.height, camera.width);
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      const auto at = camera.Unproject({x, y});
      const Eigen::Vector3d ray = T_world_color.linear() * at->homogeneous().normalized();
      const Eigen::Vector3d hit =
          T_world_color.translation() + room.Range(T_world_color.translation(), ray) * ray;
      const bool block = room.block.exteriorDistance(hit) < 1e-6;
      picture(y, x) = block ? cv::Vec3b(90, 90, 90) : cv::Vec3b(170, 180, 180);
    }
  }
  return picture;
}

TEST(EdgePlacement, BringsTheBlocksEdgesToWhereThePicturesHaveThem) {
  const Scanned& s = ScannedRoom();
  PinholeCamera camera = BoxRoomRig().color;  // twice as fine
  camera.width *= 2, camera.height *= 2, camera.fx *= 2, camera.fy *= 2;
  camera.cx = 2 * (camera.cx + 0.5) - 0.5, camera.cy = 2 * (camera.cy + 0.5) - 0.5;
  std::vector<PosedPicture> views;
  for (const RigidTransform& T : s.poses) views.push_back({PictureOf(s.room, camera, T), T});
  DenseSurface placed{s.dense.inverse_range.clone(), s.dense.node.clone()};
  ASSERT_TRUE(PlaceEdges(s.mesh, camera, views, s.nodes, s.grid, placed));
  auto wrong = [&](const DenseSurface& dense) {
    int count = 0;
    for (int y = 0; y < s.grid.height(); ++y) {
      for (int x = s.grid.width() / 4; x < s.grid.width() * 3 / 4; ++x) {
        const double truth = s.room.Range(s.grid.panorama().center, s.grid.Ray(x, y).cast<double>());
        count += dense.inverse_range(y, x) > 0 && std::abs(1 / dense.inverse_range(y, x) - truth) > 0.15;
      }
    }
    return count;
  };
  const int before = wrong(s.dense), after = wrong(placed);
  EXPECT_GT(before, 80);
  EXPECT_LT(after, before / 2) << before;
}

TEST(EdgePlacement, FollowsColourAndLeavesWhatHasNone) {
  // A ragged edge in depth; the picture's edge is straight at column 40, or there is none.
  cv::Mat1f depth(60, 80, 0.25f);
  for (int y = 0; y < depth.rows; ++y) depth.row(y).colRange(0, 40 + (y / 3 % 3 - 1) * 3) = 0.5f;
  cv::Mat3b picture(depth.size(), cv::Vec3b(60, 60, 160));
  const cv::Mat3b plain = picture.clone();
  picture.colRange(0, 40) = cv::Vec3b(120, 120, 120);
  auto wrong = [](const cv::Mat1f& d) {
    return cv::countNonZero(d.colRange(0, 40) < 0.4f) + cv::countNonZero(d.colRange(40, 80) > 0.4f);
  };
  EXPECT_GT(wrong(depth), 80);
  EXPECT_LT(wrong(SnapToColor(picture, depth)), 8);
  EXPECT_LE(wrong(SnapToColor(plain, depth)), wrong(depth));
}

TEST(SurfaceMesh, IsCutAtTheBlockAndTightElsewhere) {
  const Scanned& s = ScannedRoom();
  ASSERT_GT(s.mesh.indices.size(), 300u);
  EXPECT_LT(s.mesh.indices.size() / 3, 40'000u);
  const Eigen::Vector3d c = s.grid.panorama().center;
  int hanging = 0, clockwise = 0;
  for (std::size_t i = 0; i + 2 < s.mesh.indices.size(); i += 3) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    double least = 1e9, most = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = s.mesh.positions[s.mesh.indices[i + k]].cast<double>();
      middle += p / 3;
      least = std::min(least, (p - c).norm());
      most = std::max(most, (p - c).norm());
    }
    const double range = (middle - c).norm(), truth = s.room.Range(c, (middle - c) / range);
    // Between the block and the wall behind it there is a metre of nothing.
    if (most - least > 0.5 && std::abs(range - truth) > 0.2) ++hanging;
    const Eigen::Vector3d a = s.mesh.positions[s.mesh.indices[i]].cast<double>(),
                          b = s.mesh.positions[s.mesh.indices[i + 1]].cast<double>(),
                          d = s.mesh.positions[s.mesh.indices[i + 2]].cast<double>();
    clockwise += (b - a).cross(d - a).dot(c - a) < 0;
  }
  EXPECT_EQ(hanging, 0);
  // Slivers seen edge-on round to either side.
  EXPECT_LE(clockwise, static_cast<int>(s.mesh.indices.size() / 300));
}

TEST(SweepLayout, SpansWhatTheCamerasSaw) {
  const Rig rig = BoxRoomRig();
  std::vector<RigidTransform> poses;
  for (const double azimuth : {-0.5, 0.5}) poses.push_back(LookTo({1, 1, 1}, azimuth, 0));
  const Panorama p = LayOutPanorama(rig.color, poses, 3);
  const double half = std::atan(0.5 * 320 / 330) * 180 / std::numbers::pi, pan = 0.5 * 180 / std::numbers::pi;
  EXPECT_NEAR(p.azimuth_left_deg, pan + half, 3);
  EXPECT_NEAR(p.azimuth_right_deg, -pan - half, 3);
  EXPECT_EQ(p.width % 3, 0);
  ASSERT_TRUE(p.Validate());
  for (double azimuth = 0; azimuth < 6; azimuth += 0.5) poses.push_back(LookTo({1, 1, 1}, azimuth, 1.4));
  const Panorama whole = LayOutPanorama(rig.color, poses, 3);
  EXPECT_DOUBLE_EQ(whole.azimuth_left_deg - whole.azimuth_right_deg, 360);
  EXPECT_DOUBLE_EQ(whole.elevation_top_deg, 90);
  ASSERT_TRUE(whole.Validate());
}

}  // namespace
}  // namespace mixstage
