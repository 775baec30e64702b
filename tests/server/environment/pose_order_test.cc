// SPDX-License-Identifier: Apache-2.0
#include "server/environment/pose_order.h"

#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/box_room.h"

namespace mixstage {
namespace {

// A patterned room swept by a head in three rows, to and fro, as a head does. (Of one even row every shift
// looks alike.)
class PosesLateTest : public testing::Test {
 protected:
  PosesLateTest() : rig_(BoxRoomRig()), depth_(RangeCamera::Of(rig_)) {
    constexpr int kColumns = 3, kRows = 3;
    std::mt19937 random(3);
    for (int i = 0; i < kColumns * kRows; ++i) {
      const int row = i / kColumns, along = i % kColumns,
                column = row % 2 == 0 ? along : kColumns - 1 - along;
      poses_.push_back(LookTo({1.5, 2, 1.4}, (17 * column - 17) * std::numbers::pi / 180, 0.22 * row - 0.3));
      ranges_.push_back(SeeBoxRoom(room_, depth_, poses_.back() * rig_.T_color_depth, 0.03, random));
      cv::Mat3b picture(rig_.color.height, rig_.color.width);
      for (int y = 0; y < picture.rows; ++y) {
        for (int x = 0; x < picture.cols; ++x) {
          const Eigen::Vector3d ray =
              poses_.back().linear() * rig_.color.Unproject({x, y})->homogeneous().normalized();
          const Eigen::Vector3d p =
              poses_.back().translation() + room_.Range(poses_.back().translation(), ray) * ray;
          const double grey = 128 + 50 * (std::sin(3 * p.x()) + std::sin(4 * p.y() + p.z()));
          picture(y, x) = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(grey));
        }
      }
      pictures_.push_back(picture);
    }
  }

  // With view i + late having the pose of view i; poses before the first are of another turn of the head.
  int Late(int late) {
    std::vector<OrderedView> views;
    for (int i = 0; i < static_cast<int>(poses_.size()); ++i) {
      const int k = i - late;
      const bool there = k >= 0 && k < static_cast<int>(poses_.size());
      views.push_back({pictures_[static_cast<std::size_t>(i)], &ranges_[static_cast<std::size_t>(i)],
                       there ? poses_[static_cast<std::size_t>(k)] : LookTo({1.5, 2, 1.4}, 2.5, 0)});
    }
    return PosesLate(views, depth_, rig_.color);
  }

  BoxRoom room_;
  Rig rig_;
  RangeCamera depth_;
  std::vector<RigidTransform> poses_;
  std::vector<RangeView> ranges_;
  std::vector<cv::Mat3b> pictures_;
};

TEST_F(PosesLateTest, AreFoundByHowManyViews) {
  EXPECT_EQ(Late(0), 0);
  EXPECT_EQ(Late(1), 1);
  EXPECT_EQ(Late(-1), -1);
  EXPECT_EQ(Late(2), 2);
}

}  // namespace
}  // namespace mixstage
