// SPDX-License-Identifier: Apache-2.0
#include "server/composite/z_key.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/composite/srgb.h"

namespace mixstage {
namespace {

// A grey 16x12 picture, CG over columns 4..11 at 2 m.
class ZKeyTest : public testing::Test {
 protected:
  ZKeyTest() {
    color_.Create(16, 12, ChromaLayout::k420);
    color_.y.setTo(100);
    color_.cb.setTo(128);
    color_.cr.setTo(128);
    cg_.bounds = {4, 0, 8, 12};
    cg_.color = cv::Mat4f(12, 8, cv::Vec4f(1, 0, 0, 1));  // opaque red
    cg_.depth_m = cv::Mat1f(12, 8, 2.f);
    cg_.drawing = 1;
    room_.revision = 1;
    room_.depth_m = cv::Mat1f(12, 16, 3.f);
    room_.sigma_m = cv::Mat1f(12, 16, 0.05f);
    alpha_ = cv::Mat1b::zeros(12, 16);
    actor_ = cv::Mat1f::zeros(6, 8);
  }
  void Run() {
    z_key_.Run({.color = &color_, .alpha = View(std::as_const(alpha_)), .actor_depth_m = View(std::as_const(actor_)),
                .room = &room_, .cg = &cg_},
               composite_, depth_mm_, cg_alpha_);
  }
  void SetActor(float z, std::uint8_t alpha) {
    alpha_.setTo(alpha);
    actor_.setTo(z);
  }

  YuvImage color_, composite_;
  CgLayer cg_;
  RoomDepth room_;
  cv::Mat1b alpha_, cg_alpha_;
  cv::Mat1f actor_;
  cv::Mat1w depth_mm_;
  ZKey z_key_;
};

TEST_F(ZKeyTest, TheNearestIsSeenAndItsDepthGoesOut) {
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 255);
  EXPECT_EQ(depth_mm_(5, 6), 2000);
  EXPECT_EQ(depth_mm_(5, 1), 3000);
  EXPECT_GT(YcbcrToRgb(composite_.y(5, 6), composite_.cb(2, 3), composite_.cr(2, 3)).r, 250);
  EXPECT_EQ(composite_.y(5, 1), 100);
}

TEST_F(ZKeyTest, AnActorInFrontHidesCgAndOneBehindIsHidden) {
  SetActor(1.5f, 255);
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 0);
  EXPECT_EQ(depth_mm_(5, 6), 1500);
  EXPECT_EQ(composite_.y(5, 6), 100);
  SetActor(2.5f, 255);
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 255);
  EXPECT_EQ(depth_mm_(5, 6), 2000);
  EXPECT_EQ(depth_mm_(5, 1), 2500);
}

TEST_F(ZKeyTest, AnActorOfUnknownDepthStandsInFront) {
  SetActor(0, 255);
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 0);
  EXPECT_EQ(depth_mm_(5, 6), 0);
}

TEST_F(ZKeyTest, TheRoomHidesCgOnlyBeyondItsNoise) {
  room_.depth_m.setTo(1.9f);  // nearer, but within 3 sigma of 50 mm
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 255);
  room_.depth_m.setTo(1.8f);
  room_.revision = 2;
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 0);
  EXPECT_EQ(depth_mm_(5, 6), 1800);
}

TEST_F(ZKeyTest, UnknownRoomNeverHidesCg) {
  room_.depth_m.setTo(0);
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 255);
}

TEST_F(ZKeyTest, HalfCoverageIsMixedInLinearLight) {
  cg_.color.setTo(cv::Vec4f(0, 0, 0, 0.5f));  // half covered by black
  Run();
  const SrgbTables& srgb = SrgbTables::Get();
  EXPECT_NEAR(composite_.y(5, 6), srgb.ToSrgb(0.5f * srgb.ToLinear(100)), 1);
  EXPECT_EQ(cg_alpha_(5, 6), 128);
}

TEST_F(ZKeyTest, WithoutCgThePictureIsUntouched) {
  z_key_.Run({.color = &color_, .alpha = {}, .actor_depth_m = {}, .room = nullptr, .cg = nullptr}, composite_, depth_mm_, cg_alpha_);
  EXPECT_EQ(cv::countNonZero(composite_.y != color_.y), 0);
  EXPECT_EQ(cv::countNonZero(depth_mm_), 0);
}

TEST_F(ZKeyTest, ALayerOfAnotherDrawingIsTakenUp) {
  Run();
  cg_.color = cv::Mat4f(12, 8, cv::Vec4f(0, 0, 1, 1));
  cg_.drawing = 2;
  Run();
  EXPECT_GT(YcbcrToRgb(composite_.y(5, 6), composite_.cb(2, 3), composite_.cr(2, 3)).b, 250);
}

TEST(SrgbTables, ThereAndBackIsExact) {
  for (int code = 0; code < 256; ++code) {
    const auto c = static_cast<std::uint8_t>(code);
    EXPECT_EQ(SrgbTables::Get().ToSrgb(SrgbTables::Get().ToLinear(c)), c);
  }
}

}  // namespace
}  // namespace mixstage
