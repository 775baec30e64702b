// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/sources/synthetic_source.h"

#include <gtest/gtest.h>

#include <unistd.h>
#include <filesystem>

#include "capture_agent/sources/synthetic_views.h"
#include "proto/base/clock.h"
#include "proto/take/take.h"
#include "tests/proto/synthetic/small_set.h"

namespace mixstage {
namespace {

// A quarter of the small set's pictures again: many views are rendered here.
Rig TinyRig() {
  Rig rig = SmallRig();
  PinholeCamera& depth = rig.depth->camera;
  rig.color.width = 64;
  rig.color.height = 48;
  for (double* value : {&rig.color.fx, &rig.color.fy, &rig.color.cx, &rig.color.cy}) *value *= 0.256;
  depth.width = 44;
  depth.height = 36;
  for (double* value : {&depth.fx, &depth.fy, &depth.cx, &depth.cy}) *value *= 0.25;
  return rig;
}

cv::Mat1w FirstDepth(Source& source) {
  for (int i = 0; i < 10; ++i) {
    auto captured = source.Next({});
    if (!captured || !*captured) break;
    const auto& picture = std::get<CapturedPicture>((*captured)->what);
    if (picture.stream == Stream::kDepth) return std::get<cv::Mat1w>(picture.content);
  }
  ADD_FAILURE() << "no depth came";
  return {};
}

TEST(SyntheticSource, ShowsWhatTheHeadSeesFromWhereItStands) {
  SyntheticHead head;
  ASSERT_TRUE(head.MoveToAt(MonotonicMicros() - 10'000'000, 21, 4));
  const SyntheticConfig config{.seed = 3, .noise = SensorNoise::kNone, .figure = false};
  auto source = MakeSyntheticSource(TinyRig(), config, &head, Pace::kMax);
  ASSERT_TRUE(source);
  const cv::Mat1w sent = FirstDepth(**source);
  auto truth = SyntheticScene::Create(TinyRig(), config);
  ASSERT_TRUE(truth);
  cv::Mat1w range, amplitude;
  truth->RenderTof(0, range, amplitude);
  EXPECT_GT(cv::norm(sent, range, cv::NORM_INF), 1'000) << "the head has turned";
  truth->Arrange(21, 4);
  truth->RenderTof(0, range, amplitude);
  EXPECT_EQ(cv::norm(sent, range, cv::NORM_INF), 0);
}

TEST(SyntheticSource, ExposesNothingWhileAShortMoveLasts) {
  SyntheticHead head;
  auto source = MakeSyntheticSource(TinyRig(), {.figure = false}, &head, Pace::kReal);
  ASSERT_TRUE(source);
  ASSERT_TRUE((*source)->Next({}));
  ASSERT_TRUE(head.MoveTo(5, 0));
  const std::int64_t sent_us = MonotonicMicros();
  for (int i = 0; i < 8; ++i) {
    const auto captured = (*source)->Next({});
    ASSERT_TRUE(captured && *captured);
    const std::int64_t t_us = (*captured)->t_us;
    EXPECT_TRUE(t_us <= sent_us + 40'000 || t_us >= head.settles_us()) << t_us - sent_us;
  }
}

// A folder that OpenTake reads, with as many pictures of each camera as the plan has.
TEST(SyntheticViews, AreWrittenAsACaptureFolderWithWhatIsKnownOfTheRig) {
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("views_test_" + std::to_string(getpid()));
  const Rig rig = TinyRig();
  const auto plan = ViewsOf(SyntheticViews::kHandEye, rig);
  ASSERT_TRUE(WriteSyntheticViews(SyntheticViews::kHandEye, rig, folder));
  const auto take = OpenTake(folder);
  ASSERT_TRUE(take) << take.error().message;
  EXPECT_TRUE(take->warnings.empty());
  EXPECT_EQ(take->color.size(), plan.size());
  EXPECT_EQ(take->depth.size(), plan.size());
  EXPECT_EQ(take->amplitude.size(), plan.size());
  EXPECT_TRUE(take->fisheye.empty());
  ASSERT_EQ(take->head.size(), plan.size());
  for (std::size_t i = 0; i < plan.size(); ++i) {
    EXPECT_NEAR(take->head[i].pan_deg, plan[i].pan_deg, 0.06);
    EXPECT_NEAR(take->head[i].tilt_deg, plan[i].tilt_deg, 0.06);
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "board.json"));
  const auto known = LoadRig(folder / "rig.json");
  ASSERT_TRUE(known);
  EXPECT_EQ(known->rig.color, rig.color);
  const Status again = WriteSyntheticViews(SyntheticViews::kHandEye, rig, folder);
  ASSERT_FALSE(again) << "nothing is overwritten";
  EXPECT_EQ(again.error().code, ErrorCode::kInvalidConfig);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace mixstage
