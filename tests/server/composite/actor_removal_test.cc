// SPDX-License-Identifier: Apache-2.0
#include "server/composite/actor_removal.h"

#include <gtest/gtest.h>

#include <utility>

#include "server/segmentation/labels.h"

namespace mixstage {
namespace {

YuvImage Flat(std::uint8_t y, std::uint8_t cb) {
  YuvImage picture;
  picture.Create(161, 121, ChromaLayout::k420);
  picture.y.setTo(y);
  picture.cb.setTo(cb);
  picture.cr.setTo(128);
  return picture;
}

TEST(ActorRemoval, TheRoomStandsWhereHeAndHisShadowWere) {
  const YuvImage live = Flat(100, 120), room = Flat(50, 140);
  cv::Mat1b alpha(121, 161, std::uint8_t{0}), label(121, 161, std::uint8_t{0});
  alpha(cv::Rect(60, 40, 20, 40)).setTo(255);
  label(cv::Rect(80, 70, 20, 10)).setTo(kLabelShadow);
  label(cv::Rect(130, 20, 10, 10)).setTo(kLabelShadow);  // somebody else's
  YuvImage empty;
  ActorRemoval removal;
  removal.Run(live, room, View(std::as_const(alpha)), View(std::as_const(label)), {1.2f, 5}, empty);
  EXPECT_EQ(empty.y(60, 70), 65);  // as bright as the room is now
  EXPECT_EQ(empty.y(75, 90), 65);
  EXPECT_EQ(empty.cb(30, 35), 142);
  EXPECT_EQ(empty.y(25, 135), 100);
  EXPECT_EQ(empty.y(60, 20), 100);  // what the camera sees now
  EXPECT_EQ(empty.y(120, 160), 100);
  EXPECT_EQ(empty.cb(30, 10), 120);
  for (int x = 20; x < 60; ++x) EXPECT_LE(std::abs(empty.y(60, x + 1) - empty.y(60, x)), 5);  // no seam
}

TEST(ActorRemoval, WithoutAnybodyThePictureIsTheCameras) {
  const YuvImage live = Flat(100, 120), room = Flat(50, 140);
  const cv::Mat1b nobody(121, 161, std::uint8_t{0});
  YuvImage empty;
  ActorRemoval removal;
  removal.Run(live, room, View(nobody), View(nobody), {}, empty);
  EXPECT_EQ(cv::countNonZero(empty.y != live.y), 0);
  EXPECT_EQ(cv::countNonZero(empty.cb != live.cb), 0);
}

}  // namespace
}  // namespace mixstage
