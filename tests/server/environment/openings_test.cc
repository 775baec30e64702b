// SPDX-License-Identifier: Apache-2.0
//
// A room known by formula whose long wall has a mirror, a doorway or a window in it.
#include "server/environment/openings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "server/environment/depth_fusion.h"
#include "server/environment/sweep_layout.h"
#include "tests/support/box_room.h"

namespace mixstage {
namespace {

using ::testing::HasSubstr;

const Eigen::AlignedBox2d kHole(Eigen::Vector2d(2.6, 0.7),
                                Eigen::Vector2d(3.6, 1.9));  // x, z on the wall y = 4

// What the depth camera measures through the hole, from a point on it along the ray; 0 = nothing comes back.
using Beyond = std::function<double(const Eigen::Vector3d& from, const Eigen::Vector3d& ray)>;

std::vector<Opening> OpeningsWith(const Beyond& beyond) {
  const BoxRoom room;
  const Rig rig = BoxRoomRig();
  const RangeCamera camera = RangeCamera::Of(rig);
  std::mt19937 random(11);
  std::normal_distribution<double> noise(0, 0.02);
  std::vector<RigidTransform> poses;
  for (const double elevation : {-0.35, 0.0, 0.35})
    for (const double azimuth : {0.0, 0.35, 0.7, 1.05, 1.4})
      poses.push_back(LookTo({1, 1.5, 1.4}, azimuth, elevation));
  constexpr int kNodeStep = 2;
  const PanoramaGrid grid(Coarser(LayOutPanorama(rig.color, poses, 3 * kNodeStep), 3));
  std::vector<PanoramaPatch> patches;
  for (const RigidTransform& T_world_color : poses) {
    const RigidTransform T_world_depth = T_world_color * camera.T_color_depth;
    RangeView view = SeeBoxRoom(room, camera, T_world_depth, 0.02, random);
    for (int y = 0; y < view.range_m.rows; ++y) {
      for (int x = 0; x < view.range_m.cols; ++x) {
        const cv::Vec3f n = camera.ray(y, x);
        const Eigen::Vector3d ray = T_world_depth.linear() * Eigen::Vector3d(n[0], n[1], n[2]);
        const Eigen::Vector3d from = T_world_depth.translation();
        const double range = room.Range(from, ray);
        const Eigen::Vector3d hit = from + range * ray;
        if (hit.y() < 3.999 || !kHole.contains(Eigen::Vector2d(hit.x(), hit.z()))) continue;
        const double more = beyond(hit, ray);
        view.range_m(y, x) = more > 0 ? static_cast<float>(range + more + noise(random)) : 0.f;
      }
    }
    patches.push_back(SeeFromCenter(view, camera, T_world_depth, grid));
  }
  SurfaceNodes nodes = MakeNodes(Fuse(patches, grid), grid, kNodeStep);
  DropIslands(nodes);
  FitPlanes(nodes);
  const std::vector<GrownPlane> planes = GrowPlanes(nodes, {});
  FitPlanes(nodes);
  return FindOpenings(nodes, planes, DescribePlanes(planes, nodes, grid.panorama().center),
                      std::vector<std::uint8_t>(nodes.ray.size(), 1), grid);
}

void ExpectTheHole(const Opening& o) {
  EXPECT_NEAR(o.area_m2, 1.2, 0.3);  // at its edges the depth camera sees both
  EXPECT_LT((o.at - Eigen::Vector3d(3.1, 4, 1.3)).norm(), 0.1) << o.at.transpose();
}

TEST(Openings, AMirrorShowsTheRoomOnceMore) {
  const BoxRoom room;
  const std::vector<Opening> found =
      OpeningsWith([&](const Eigen::Vector3d& from, const Eigen::Vector3d& ray) {
        return room.Range(from - 1e-9 * Eigen::Vector3d::UnitY(), {ray.x(), -ray.y(), ray.z()});
      });
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].kind, Opening::Kind::kMirror);
  ExpectTheHole(found[0]);
  EXPECT_GT(found[0].behind_m, 1);
  EXPECT_THAT(found[0].plane, HasSubstr("wall"));
  EXPECT_THAT(Described(found[0]), HasSubstr(found[0].plane + " has a mirror of 1."));
}

TEST(Openings, ADoorwayShowsAnotherRoom) {
  // A corridor 0.9 m wide.
  const std::vector<Opening> found =
      OpeningsWith([](const Eigen::Vector3d&, const Eigen::Vector3d& ray) { return 0.9 / ray.y(); });
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].kind, Opening::Kind::kBehind);
  ExpectTheHole(found[0]);
  EXPECT_GT(found[0].behind_m, 0.9);
}

TEST(Openings, AWindowGivesNoRange) {
  const std::vector<Opening> found =
      OpeningsWith([](const Eigen::Vector3d&, const Eigen::Vector3d&) { return 0.0; });
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].kind, Opening::Kind::kNoRange);
  ExpectTheHole(found[0]);
  EXPECT_THAT(Described(found[0]), HasSubstr("gave no range"));
}

TEST(Openings, APictureOnTheWallIsNone) {
  // A niche of a picture frame's depth.
  EXPECT_TRUE(OpeningsWith([](const Eigen::Vector3d&, const Eigen::Vector3d& ray) {
                return 0.05 / ray.y();
              }).empty());
}

}  // namespace
}  // namespace mixstage
