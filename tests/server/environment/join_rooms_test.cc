// SPDX-License-Identifier: Apache-2.0
//
// A room known by formula, scanned from two places, or before and after its block was carried away.
#include "server/environment/join_rooms.h"

#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/box_room.h"

namespace mixstage {
namespace {

constexpr double kRad = std::numbers::pi / 180;

// What a perfect scan from `center` has: ranges, and a mesh of the panorama's cells that are cut at steps.
// Its world lies at T_room_world.
RoomScan ScanFrom(const BoxRoom& room, const Eigen::Vector3d& center, const RigidTransform& T_room_world,
                  std::uint8_t grey) {
  RoomScan scan;
  Panorama& p = scan.environment.panorama;
  p = {.width = 480, .height = 240, .center = T_room_world.inverse() * center};
  scan.pictures.range_mm.create(p.height, p.width);
  scan.pictures.color_bgra = cv::Mat4b(p.height, p.width, cv::Vec4b(grey, grey, grey, 255));
  scan.room.texture_bgr = cv::Mat3b(p.height, p.width, cv::Vec3b(grey, grey, grey));
  std::vector<double> range;
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const Eigen::Vector3d ray = p.Ray(x, y);
      range.push_back(room.Range(center, T_room_world.linear() * ray));
      scan.pictures.range_mm(y, x) = cv::saturate_cast<std::uint16_t>(1000 * range.back());
      scan.room.positions.push_back((p.center + range.back() * ray).cast<float>());
      scan.room.uvs.emplace_back((static_cast<float>(x) + 0.5f) / static_cast<float>(p.width),
                                 (static_cast<float>(y) + 0.5f) / static_cast<float>(p.height));
    }
  }
  for (int y = 0; y + 1 < p.height; ++y) {
    for (int x = 0; x + 1 < p.width; ++x) {
      const auto i = static_cast<std::uint32_t>(y * p.width + x), w = static_cast<std::uint32_t>(p.width);
      const auto [least, most] = std::minmax({range[i], range[i + 1], range[i + w], range[i + w + 1]});
      if (most - least > 0.1) continue;
      for (const std::uint32_t k : {i, i + w, i + w + 1, i, i + w + 1, i + 1}) scan.room.indices.push_back(k);
    }
  }
  return scan;
}

RigidTransform Moved(double turn_deg, const Eigen::Vector3d& shift) {
  RigidTransform T = RigidTransform::Identity();
  T.linear() =
      Eigen::AngleAxisd(turn_deg * kRad, Eigen::Vector3d(0.05, -0.08, 1).normalized()).toRotationMatrix();
  T.translation() = shift;
  return T;
}

bool HasTriangleNear(const RoomModel& room, const Eigen::Vector3d& p, double within_m) {
  for (std::size_t t = 0; t + 2 < room.indices.size(); t += 3) {
    const Eigen::Vector3f middle = (room.positions[room.indices[t]] + room.positions[room.indices[t + 1]] +
                                    room.positions[room.indices[t + 2]]) /
                                   3;
    if ((middle.cast<double>() - p).norm() < within_m) return true;
  }
  return false;
}

TEST(MeetRooms, FindsWhereTheSecondScanStood) {
  const BoxRoom room;
  const RoomScan first = ScanFrom(room, {1, 1, 1.4}, RigidTransform::Identity(), 100);
  const RigidTransform T_room_world = Moved(4, {0.2, -0.15, 0.03});  // what its rig says is off by that
  const RoomScan second = ScanFrom(room, {4.2, 3, 1.2}, T_room_world, 100);
  JoinReport report;
  const RigidTransform off = MeetRooms(first, second, report).inverse() * T_room_world;
  EXPECT_LT(Eigen::AngleAxisd(off.linear()).angle() / kRad, 0.1);
  EXPECT_LT((off * second.environment.panorama.center - second.environment.panorama.center).norm(), 0.005);
  EXPECT_GT(report.met, 0.6);
  EXPECT_LT(report.apart_m, 0.01);
}

TEST(MeetRooms, AnotherRoomDoesNotMeet) {
  BoxRoom other;
  other.room = Eigen::AlignedBox3d(Eigen::Vector3d(-3, -1, -1.5), Eigen::Vector3d(9, 9, 5));
  JoinReport report;
  MeetRooms(ScanFrom(BoxRoom(), {1, 1, 1.4}, RigidTransform::Identity(), 100),
            ScanFrom(other, {1, 1, 1.4}, RigidTransform::Identity(), 100), report);
  EXPECT_LT(report.met, 0.5);
}

TEST(JoinRooms, MergingAddsWhatTheFirstCouldNotSeeAndNothingElse) {
  const BoxRoom room;
  const RoomScan first = ScanFrom(room, {1, 1.8, 1.4}, RigidTransform::Identity(), 100);
  const RoomScan second = ScanFrom(room, {4.6, 1.8, 1.4}, RigidTransform::Identity(), 80);
  const Eigen::Vector3d back_of_block(3.6, 1.8, 0.6), near_wall(0, 2, 1.2);
  ASSERT_FALSE(HasTriangleNear(first.room, back_of_block, 0.1));
  JoinReport report;
  const RoomScan joined = JoinRooms(first, second, RigidTransform::Identity(), Join::kMerge, report);
  ASSERT_TRUE(joined.room.Validate());
  EXPECT_TRUE(HasTriangleNear(joined.room, back_of_block, 0.1));
  EXPECT_LT(report.added, second.room.triangle_count() / 3);
  EXPECT_NEAR(report.gain, 100.0 / 80, 0.01);
  EXPECT_EQ(cv::norm(joined.pictures.range_mm, first.pictures.range_mm, cv::NORM_INF), 0);
}

TEST(JoinRooms, APatchReplacesWhatIsGone) {
  const BoxRoom before;
  BoxRoom after;
  after.block = Eigen::AlignedBox3d(Eigen::Vector3d(0.1, 0.1, 0), Eigen::Vector3d(0.2, 0.2, 0.1));
  const RoomScan first = ScanFrom(before, {1, 1.8, 1.4}, RigidTransform::Identity(), 100);
  const RoomScan second = ScanFrom(after, {1.05, 1.8, 1.4}, RigidTransform::Identity(), 100);
  const Eigen::Vector3d front_of_block(3, 1.8, 0.6), floor_there(3.2, 1.8, 0);
  ASSERT_TRUE(HasTriangleNear(first.room, front_of_block, 0.1));
  JoinReport report;
  const RoomScan joined = JoinRooms(first, second, RigidTransform::Identity(), Join::kPatch, report);
  ASSERT_TRUE(joined.room.Validate());
  EXPECT_FALSE(HasTriangleNear(joined.room, front_of_block, 0.1));
  EXPECT_TRUE(HasTriangleNear(joined.room, floor_there, 0.15));
  // The panorama as well: where the block's front was there is what stood behind it.
  const Panorama& p = joined.environment.panorama;
  const Eigen::Vector3d ray = (Eigen::Vector3d(3, 1.8, 0.6) - p.center).normalized();
  const auto pixel = p.Pixel(ray);
  ASSERT_TRUE(pixel);
  const cv::Point at(static_cast<int>(std::lround(pixel->x())), static_cast<int>(std::lround(pixel->y())));
  EXPECT_NEAR(joined.pictures.range_mm(at) / 1000.0, after.Range(p.center, p.Ray(at.x, at.y)),
              0.1);  // a pixel of it slants
}

}  // namespace
}  // namespace mixstage
