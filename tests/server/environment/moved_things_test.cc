// SPDX-License-Identifier: Apache-2.0
//
// A block that stands elsewhere while one view of a sweep is taken.
#include "server/environment/moved_things.h"

#include <gtest/gtest.h>

#include <random>

#include "server/environment/sweep_layout.h"
#include "tests/support/box_room.h"

namespace mixstage {
namespace {

constexpr double kSigma_m = 0.02;
constexpr std::size_t kOdd = 2;  // the view that sees the block elsewhere

struct Sweep {
  Rig rig = BoxRoomRig();
  RangeCamera camera = RangeCamera::Of(rig);
  std::vector<PosedPicture> views;
  PanoramaGrid grid{Panorama{.width = 1, .height = 1}};
  std::vector<PanoramaPatch> patches;
  FusedDepth fused;

  explicit Sweep(const BoxRoom& odd_room) {
    std::vector<RigidTransform> poses;
    for (const double azimuth : {-0.3, -0.15, 0.0, 0.15, 0.3})
      poses.push_back(LookTo({1, 1.7, 1.4}, azimuth, -0.2));
    grid = PanoramaGrid(Coarser(LayOutPanorama(rig.color, poses, 6), 3));
    std::mt19937 random(5);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      views.push_back({cv::Mat3b(rig.color.height, rig.color.width), poses[i]});
      const BoxRoom room = i == kOdd ? odd_room : BoxRoom();
      const RigidTransform T_world_depth = poses[i] * camera.T_color_depth;
      patches.push_back(SeeFromCenter(SeeBoxRoom(room, camera, T_world_depth, kSigma_m, random), camera,
                                      T_world_depth, grid));
    }
    fused = Fuse(patches, grid);
  }
};

TEST(MovedThings, ARoomThatRestsHasNone) {
  const Sweep sweep{BoxRoom()};
  EXPECT_TRUE(FindMovedThings(sweep.patches, sweep.fused, sweep.grid, sweep.camera.pitch_rad).empty());
}

TEST(MovedThings, ABlockThatMovedIsFoundWhereItStoodAndWhereItWasMissing) {
  BoxRoom odd;
  odd.block.translate(Eigen::Vector3d(-0.3, -0.7, 0));
  const Sweep sweep(odd);
  const auto things = FindMovedThings(sweep.patches, sweep.fused, sweep.grid, sweep.camera.pitch_rad);
  ASSERT_GE(things.size(), 2u);
  bool stood = false, missing = false;
  for (const MovedThing& thing : things) {
    EXPECT_EQ(thing.view, kOdd);
    EXPECT_GE(thing.area_m2, 0.02);
    const Eigen::Vector3d at = thing.at;
    if (thing.nearer_m > 0.3) stood |= odd.block.exteriorDistance(at) < 0.05;
    if (thing.nearer_m < -0.3) missing = true;
  }
  EXPECT_TRUE(stood);
  EXPECT_TRUE(missing);
}

TEST(MovedThings, NothingBehindThemIsSeenByTheirView) {
  BoxRoom odd;
  odd.block.translate(Eigen::Vector3d(-0.3, -0.7, 0));
  const Sweep sweep(odd);
  const auto things = FindMovedThings(sweep.patches, sweep.fused, sweep.grid, sweep.camera.pitch_rad);
  constexpr float kNothing = 1e6f;
  std::vector<ViewOcclusion> occlusions(sweep.views.size());
  for (ViewOcclusion& o : occlusions) o.depth_m = cv::Mat1f(120, 160, kNothing);
  HideMovedThings(things, sweep.rig.color, sweep.views, sweep.camera.pitch_rad, occlusions);
  const auto hides = [&](std::size_t view, const Eigen::Vector3d& p) {
    const auto pixel = sweep.rig.color.Project(sweep.views[view].T_world_color.inverse() * p);
    return occlusions[view].depth_m(static_cast<int>(pixel->y() / 2), static_cast<int>(pixel->x() / 2)) <
           0.1f;
  };
  const Eigen::Vector3d in_front = odd.block.center() - Eigen::Vector3d(0.3, 0, 0);
  EXPECT_TRUE(hides(kOdd, in_front));
  EXPECT_FALSE(hides(kOdd + 1, in_front));
  EXPECT_FALSE(hides(kOdd, Eigen::Vector3d(5, 2.2, 1.4)));  // the far wall beside it
}

}  // namespace
}  // namespace mixstage
