// SPDX-License-Identifier: Apache-2.0
#include "server/composite/z_key.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/base/srgb.h"
#include "server/composite/mix.h"

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
    z_key_.Run({.color = &color_,
                .alpha = View(std::as_const(alpha_)),
                .actor_depth_m = View(std::as_const(actor_)),
                .room = &room_,
                .cg = &cg_},
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

TEST_F(ZKeyTest, CgInTheRoomsSurfaceHidesNobody) {
  room_.depth_m.setTo(2.1f);  // CG lies in it, within 3 sigma of 50 mm
  SetActor(2.2f, 255);        // his depth's noise: nobody stands behind a wall
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 0);
  EXPECT_EQ(composite_.y(5, 6), 100);
  room_.depth_m.setTo(2.3f);
  room_.revision = 2;
  Run();
  EXPECT_EQ(cg_alpha_(5, 6), 255);
  EXPECT_EQ(depth_mm_(5, 6), 2000);
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
  z_key_.Run({.color = &color_, .alpha = {}, .actor_depth_m = {}, .room = nullptr, .cg = nullptr}, composite_,
             depth_mm_, cg_alpha_);
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

TEST_F(ZKeyTest, TheActorsSoftEdgeLetsCgThroughByItsRest) {
  SetActor(1.5f, 0);
  alpha_(cv::Rect(0, 0, 6, 12)).setTo(255);
  alpha_(cv::Rect(6, 0, 1, 12)).setTo(64);
  Run();
  const SrgbTables& srgb = SrgbTables::Get();
  EXPECT_EQ(cg_alpha_(5, 5), 0);
  EXPECT_EQ(cg_alpha_(5, 6), 191);
  EXPECT_EQ(cg_alpha_(5, 7), 255);
  const float real = srgb.ToLinear(100);
  const float share = 64.f / 255;
  const Ycbcr8 truth = RgbToYcbcr(
      {srgb.ToSrgb(share * real + 1 - share), srgb.ToSrgb(share * real), srgb.ToSrgb(share * real)});
  EXPECT_NEAR(composite_.y(5, 6), truth.y, 1);
  EXPECT_NEAR(composite_.cr(2, 3), (truth.cr + RgbToYcbcr({255, 0, 0}).cr + 1) / 2, 1);
  EXPECT_EQ(depth_mm_(5, 5), 1500);
  EXPECT_EQ(depth_mm_(5, 6), 2000);
}

TEST_F(ZKeyTest, BeforeCgTheActorsSoftEdgeHasHisOwnColor) {
  SetActor(1.5f, 128);
  const cv::Mat3b own(12, 16, cv::Vec3b(0, 0, 255));
  z_key_.Run({.color = &color_,
              .alpha = View(std::as_const(alpha_)),
              .actor_depth_m = View(std::as_const(actor_)),
              .foreground = &own,
              .room = &room_,
              .cg = &cg_},
             composite_, depth_mm_, cg_alpha_);
  const SrgbTables& srgb = SrgbTables::Get();
  const float share = 128.f / 255;
  const Ycbcr8 truth = RgbToYcbcr({srgb.ToSrgb(1 - share), 0, srgb.ToSrgb(share)});
  EXPECT_NEAR(composite_.y(5, 6), truth.y, 1);
  EXPECT_NEAR(composite_.cb(2, 3), truth.cb, 1);
  EXPECT_EQ(composite_.y(5, 1), 100);  // no CG: the picture as it is
}

TEST(ZKey, OddSizesAndEveryLayoutAreDrawnToTheLastPixel) {
  for (const auto layout : {ChromaLayout::k444, ChromaLayout::k422, ChromaLayout::k420}) {
    YuvImage color, composite;
    color.Create(37, 23, layout);
    for (cv::Mat1b* plane : {&color.y, &color.cb, &color.cr}) plane->setTo(128);
    CgLayer cg;
    cg.bounds = {2, 4, 35, 19};
    cg.color = cv::Mat4f(19, 35, cv::Vec4f(0, 0, 1, 1));
    cg.depth_m = cv::Mat1f(19, 35, 2.f);
    cg.drawing = 1;
    cv::Mat1w depth_mm;
    cv::Mat1b cg_alpha;
    ZKey z_key;
    z_key.Run({.color = &color, .alpha = {}, .actor_depth_m = {}, .room = nullptr, .cg = &cg}, composite,
              depth_mm, cg_alpha);
    EXPECT_EQ(cv::countNonZero(cg_alpha), 35 * 19);
    EXPECT_EQ(cv::countNonZero(depth_mm == 2000), 35 * 19);
    const Ycbcr8 blue = RgbToYcbcr({0, 0, 255});
    EXPECT_EQ(composite.y(22, 36), blue.y);
    EXPECT_EQ(composite.cb(composite.cb.rows - 1, composite.cb.cols - 1), blue.cb);
    EXPECT_EQ(composite.cr(composite.cr.rows - 1, 0), 128);
    EXPECT_EQ(composite.y(3, 36), 128);
  }
}

TEST(Mix, WholeNumberConversionsAreThoseOfTheCodecWithinOneLevel) {
  for (int a = 0; a < 256; a += 5) {
    for (int b = 0; b < 256; b += 5) {
      for (int c = 0; c < 256; c += 5) {
        const auto x = static_cast<std::uint8_t>(a), y = static_cast<std::uint8_t>(b),
                   z = static_cast<std::uint8_t>(c);
        const Rgb8 rgb = YcbcrToRgb(x, y, z), fixed = FixedYcbcrToRgb(a, b, c);
        ASSERT_LE(std::max({std::abs(rgb.r - fixed.r), std::abs(rgb.g - fixed.g), std::abs(rgb.b - fixed.b)}),
                  1);
        const Ycbcr8 ycc = RgbToYcbcr({x, y, z}), whole = FixedRgbToYcbcr({x, y, z});
        ASSERT_LE(
            std::max({std::abs(ycc.y - whole.y), std::abs(ycc.cb - whole.cb), std::abs(ycc.cr - whole.cr)}),
            1);
      }
    }
  }
}

TEST(SrgbTables, ThereAndBackIsExact) {
  for (int code = 0; code < 256; ++code) {
    const auto c = static_cast<std::uint8_t>(code);
    EXPECT_EQ(SrgbTables::Get().ToSrgb(SrgbTables::Get().ToLinear(c)), c);
  }
}

}  // namespace
}  // namespace mixstage
