// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/rig.h"

#include <gtest/gtest.h>

namespace mixstage {
namespace {

constexpr const char* kSmall = R"({"version": 1, "cameras": {
  "color": {"model": "pinhole", "width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5},
  "depth": {"model": "pinhole", "width": 32, "height": 24, "fx": 30, "fy": 30, "cx": 15.5, "cy": 11.5,
            "measures": "range", "unit_m": 0.00025, "unambiguous_range_m": 7.4948,
            "range_error": {"range_m": [1, 2, 3], "error_m": [0.01, -0.02, 0.0]}}},
  "T_color_depth": [1, 0, 0, 0.07, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]})";

std::string With(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(Rig, ReadsWhatIsGivenAndTakesTheRestAsNominal) {
  const auto rig = ParseRig(kSmall);
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_TRUE(rig->warnings.empty());
  EXPECT_EQ(rig->rig.color.k1, 0);
  EXPECT_EQ(rig->rig.depth->measures, DepthMeasure::kRange);
  EXPECT_DOUBLE_EQ(rig->rig.T_color_depth.translation().x(), 0.07);
  EXPECT_FALSE(rig->rig.fisheye);
  EXPECT_FALSE(rig->rig.registered);
}

TEST(Rig, ErrorsNameTheField) {
  const std::pair<std::string, std::string> cases[] = {
      {With(kSmall, "\"fx\": 60", "\"fx\": 0"), "cameras.color.fx"},
      {With(kSmall, "\"fx\": 60", "\"fx\": \"wide\""), "cameras.color.fx"},
      {With(kSmall, "\"fx\": 30", "\"fx\": 1e999"), "JSON"},
      {With(kSmall, "\"unit_m\": 0.00025", "\"unit_m\": -1"), "cameras.depth.unit_m"},
      {With(kSmall, "\"range\"", "\"steps\""), "cameras.depth.measures"},
      {With(kSmall, "[1, 2, 3]", "[1, 3, 2]"), "range_m"},
      {With(kSmall, "[1, 2, 3]", "[1, 2]"), "error_m"},
      {With(kSmall, "\"error_m\"", "\"std_m\": [0.001], \"error_m\""), "std_m"},
      {With(kSmall, "0.07, 0, 1, 0, 0", "0.07, 0, 2, 0, 0"), "T_color_depth"},
      {With(kSmall, "\"version\": 1", "\"version\": 7"), "version"},
      {R"({"version": 1})", "cameras.color"},
      {"[]", "JSON"},
      {"{", "JSON"},
  };
  for (const auto& [text, word] : cases) {
    const auto rig = ParseRig(text);
    ASSERT_FALSE(rig) << text;
    EXPECT_EQ(rig.error().code, ErrorCode::kBadInput);
    EXPECT_NE(rig.error().message.find(word), std::string::npos) << rig.error().message << " lacks " << word;
  }
}

TEST(Rig, UnknownKeysWarnByTheirPath) {
  const auto rig = ParseRig(With(kSmall, "\"cy\": 23.5", "\"cy\": 23.5, \"colour\": 1"));
  ASSERT_TRUE(rig);
  ASSERT_EQ(rig->warnings.size(), 1u);
  EXPECT_NE(rig->warnings[0].find("cameras.color.colour"), std::string::npos);
}

TEST(Rig, RegisteredNeedsOnlyTheUnit) {
  const auto rig = ParseRig(R"({"version": 1, "registered": true, "cameras": {
      "color": {"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}, "depth": {"unit_m": 0.0002}}})");
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_EQ(rig->rig.depth->camera, rig->rig.color);
  EXPECT_EQ(rig->rig.depth->measures, DepthMeasure::kZ);
}

TEST(RangeError, TrueRangeUndoesTheSensor) {
  const RangeError curve{{1, 2, 3}, {0.01, -0.02, 0.0}};
  for (double range = 0.5; range < 4; range += 0.01) {
    EXPECT_NEAR(curve.TrueRange(range + curve.At(range)), range, 1e-6);
  }
  EXPECT_DOUBLE_EQ(curve.At(0.2), 0.01);
  EXPECT_DOUBLE_EQ(curve.At(9.0), 0.0);
  EXPECT_EQ(curve.StdAt(2.5), 0);
  EXPECT_DOUBLE_EQ((RangeError{{1, 2, 3}, {0, 0, 0}, {0.001, 0.002, 0.004}}.StdAt(2.5)), 0.003);
}

TEST(PanTilt, PositivePanTurnsLeftAndTiltTurnsUp) {
  PanTilt ptu;
  ptu.tilt_axis.direction = -Eigen::Vector3d::UnitY();
  // Camera looks along the world's x: its z is x, its x is -y, its y is -z.
  ptu.T_tilt_color.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Eigen::Vector3d forward = ptu.TWorldColor(30, 0).linear() * Eigen::Vector3d::UnitZ();
  EXPECT_GT(forward.y(), 0.4);  // left of x is y
  const Eigen::Vector3d up = ptu.TWorldColor(0, 20).linear() * Eigen::Vector3d::UnitZ();
  EXPECT_GT(up.z(), 0.3);
}

TEST(Rig, IsReadBackAsItWasWritten) {
  Rig rig;
  rig.color = {.width = 64,
               .height = 48,
               .fx = 60.125,
               .fy = 61,
               .cx = 31.3,
               .cy = 23.7,
               .k1 = -0.1,
               .p2 = 1e-4,
               .k6 = 0.3};
  rig.vignetting_a = -0.16;
  rig.depth.emplace();
  rig.depth->camera = {.width = 32, .height = 24, .fx = 30, .fy = 30, .cx = 15, .cy = 11, .k2 = 0.1};
  rig.depth->unit_m = 0.00025;
  rig.depth->unambiguous_range_m = 7.4948;
  rig.depth->range_error = {{1, 2, 3}, {0.01, -0.02, 1.0 / 3}, {0.001, 0.0, 0.005}};
  rig.T_color_depth.translation() = Eigen::Vector3d(0.06, -0.001, 1.0 / 7);
  rig.T_color_depth.rotate(Eigen::AngleAxisd(0.01, Eigen::Vector3d(1, 2, 3).normalized()));
  rig.fisheye.emplace();
  *rig.fisheye = {.width = 40, .height = 40, .fx = 12, .fy = 12, .cx = 19, .cy = 20, .k1 = 0.01, .k4 = 1e-3};
  rig.depth_time_offset_s = 0.0073;
  rig.ptu.emplace();
  rig.ptu->tilt_axis.direction = Eigen::Vector3d(0.01, -1, 0.02).normalized();
  rig.ptu->tilt_axis.point = Eigen::Vector3d(0.01, 0, 0.05);
  rig.ptu->pan_scale = 1.003;
  const std::string text = FormatRig(rig);
  const auto again = ParseRig(text);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_TRUE(again->warnings.empty());
  EXPECT_EQ(again->rig.color, rig.color);
  EXPECT_EQ(again->rig.depth->camera, rig.depth->camera);
  EXPECT_EQ(again->rig.depth->range_error, rig.depth->range_error);
  EXPECT_EQ(again->rig.depth->unambiguous_range_m, rig.depth->unambiguous_range_m);
  EXPECT_NEAR(again->rig.fisheye->max_angle_rad, rig.fisheye->max_angle_rad, 1e-12);
  EXPECT_EQ(again->rig.depth_time_offset_s, rig.depth_time_offset_s);
  EXPECT_TRUE(again->rig.T_color_depth.isApprox(rig.T_color_depth, 1e-12));
  EXPECT_TRUE(again->rig.ptu->TWorldColor(10, -5).isApprox(rig.ptu->TWorldColor(10, -5), 1e-12));
  EXPECT_FALSE(ParseRig("{}"));
}

TEST(RigidTransform, RefusesWhatIsNotRigid) {
  EXPECT_TRUE(RigidFromRowMajor({0, -1, 0, 5, 1, 0, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1}));
  EXPECT_FALSE(RigidFromRowMajor({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1}));  // a mirror
  EXPECT_FALSE(RigidFromRowMajor({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1}));
  EXPECT_FALSE(RigidFromTum({0, 0, 0, 0, 0, 0, 0}));
}

}  // namespace
}  // namespace mixstage
