// SPDX-License-Identifier: Apache-2.0
#include "server/app/regions_file.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace mixstage {
namespace {

double Least(const RoomRegion& region, const Eigen::Vector3d& p) {
  double least = 1e9;
  for (const Eigen::Vector4d& plane : region.planes)
    least = std::min(least, plane.head<3>().dot(p) + plane.w());
  return least;
}

TEST(RegionsFile, ABoxIsTurnedAboutUp) {
  const auto regions = ParseRegions(
      "version: 1\n"
      "regions:\n"
      "  - {name: desk, kind: hold_out, box: {center: [1, 2, 0.5], size: [2, 1, 1], turn_deg: 90}}\n"
      "  - {name: back, kind: garbage, planes: [[2, 0, 0, -6], [0, 0, 1, 0]]}\n",
      "regions.yaml");
  ASSERT_TRUE(regions) << regions.error().message;
  ASSERT_EQ(regions->regions.size(), 2u);
  const RoomRegion& desk = regions->regions[0];
  EXPECT_EQ(desk.kind, RegionKind::kHoldOut);
  EXPECT_NEAR(Least(desk, {1, 2.9, 0.5}), 0.1, 1e-9);  // its long side runs along y now
  EXPECT_NEAR(Least(desk, {1.6, 2, 0.5}), -0.1, 1e-9);
  EXPECT_NEAR(Least(desk, {1, 2, 1.2}), -0.2, 1e-9);
  const RoomRegion& back = regions->regions[1];
  EXPECT_EQ(back.kind, RegionKind::kGarbage);
  EXPECT_NEAR(Least(back, {3.5, 7, 0.7}), 0.5, 1e-9);
}

TEST(RegionsFile, MistakesNameFileLineAndKey) {
  const std::pair<const char*, const char*> cases[] = {
      {"version: 2\nregions: []\n", "version"},
      {"version: 1\n", "regions"},
      {"frame: head\nregions: []\n", "frame"},
      {"regions: [{kind: garbage, planes: [[1, 0, 0, 0]]}]\n", "name"},
      {"regions: [{name: a, kind: trash, planes: [[1, 0, 0, 0]]}]\n", "kind"},
      {"regions: [{name: a, kind: garbage}]\n", "box"},
      {"regions: [{name: a, kind: garbage, box: {center: [0, 0, 0], size: [1, 1, 1]}, planes: [[1, 0, 0, "
       "0]]}]\n",
       "exactly one"},
      {"regions: [{name: a, kind: garbage, box: {center: [0, 0, 0]}}]\n", "size"},
      {"regions: [{name: a, kind: garbage, box: {center: [0, 0, 0], size: [1, -1, 1]}}]\n", "size"},
      {"regions: [{name: a, kind: garbage, box: {center: [0, .nan, 0], size: [1, 1, 1]}}]\n", "center"},
      {"regions: [{name: a, kind: garbage, box: {center: [0, 0, 0], size: [1, 1, 1], tilt_deg: 3}}]\n",
       "tilt_deg"},
      {"regions: [{name: a, kind: garbage, planes: [[0, 0, 0, 1]]}]\n", "normal"},
      {"regions: [{name: a, kind: garbage, planes: [[1, 0, 0]]}]\n", "planes"},
      {"regions: [{name: a, kind: garbage, planes: [[0, 0, 1, 1], [0, 0, -1, -2]]}]\n", "nothing between"},
      {"regions: [{name: a, kind: garbage, planes: [[1, 0, 0, 0]]}, {name: a, kind: garbage, planes: [[1, 0, "
       "0, 0]]}]\n",
       "another"},
      {"{", "regions.yaml"}};
  for (const auto& [text, word] : cases) {
    const auto regions = ParseRegions(text, "regions.yaml");
    ASSERT_FALSE(regions) << text;
    EXPECT_EQ(regions.error().code, ErrorCode::kInvalidConfig);
    EXPECT_NE(regions.error().message.find(word), std::string::npos) << regions.error().message;
    EXPECT_NE(regions.error().message.find("regions.yaml:"), std::string::npos) << regions.error().message;
  }
}

}  // namespace
}  // namespace mixstage
