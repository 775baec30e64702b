// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/live_ingest.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include "server/ingest/take_ingest.h"

#include <limits>

namespace mixstage {
namespace {

// A head of 16x16 colour and 8x8 depth whose pictures are fed slice by slice.
class LiveIngestTest : public testing::Test {
 protected:
  LiveIngestTest() : rig_(SmallRig()), ingest_(rig_, out_, &recorder_) {}
  ~LiveIngestTest() override { std::filesystem::remove_all(folder_); }

  static Rig SmallRig() {
    Rig rig = AssumedRig(16, 16, 0.001);
    rig.registered = false;
    rig.depth->camera.width = rig.depth->camera.height = 8;
    return rig;
  }
  void SendColor(std::int64_t sequence, std::int64_t t_us, std::int64_t epoch = 7) {
    YuvImage image;
    image.Create(16, 16, ChromaLayout::k420);
    image.y.setTo(static_cast<double>(sequence));
    image.cb.setTo(128);
    image.cr.setTo(128);
    EncodedFrame frame{
        .epoch = epoch, .t_us = t_us, .sequence = sequence, .width = 16, .height = 16, .bytes = {}};
    ASSERT_TRUE(JpegEncoder().Encode(image, 90, frame.bytes));
    Send(frame, IsCountable(t_us) ? t_us + kTravelUs : kTravelUs);  // a lie does not change when it comes
  }
  void SendDepth(std::int64_t sequence, std::int64_t t_us, int side = 8) {
    EncodedFrame frame{.epoch = 7,
                       .t_us = t_us,
                       .sequence = sequence,
                       .stream = Stream::kDepth,
                       .encoding = Encoding::kDepth16,
                       .width = side,
                       .height = side,
                       .bytes = {}};
    DepthEncoder().Encode(View(cv::Mat1w(side, side, static_cast<std::uint16_t>(sequence + 1))), frame.bytes);
    Send(frame, t_us + kTravelUs);
  }
  void Send(const EncodedFrame& frame, std::int64_t now_us) {
    CutIntoSlices(frame, [&](const mixstage_lcm::frame_slice_t& s) { ingest_.OnSlice(s, now_us); });
    ingest_.Poll(now_us);
  }
  // What waited for an older picture waits no longer, and the counters are up to date.
  IngestStatus StatusAt(std::int64_t now_us) {
    ingest_.Poll(now_us);
    return ingest_.Status();
  }
  std::shared_ptr<const CapturedFrame> Newest() { return *out_.Pop(); }

  static constexpr std::int64_t kTravelUs = 400;
  Rig rig_;
  CapturedFrames out_{1, WhenFull::kDropOldest};
  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("mixstage_live_ingest_" + std::to_string(getpid()));
  TakeRecorder recorder_{{.folder = folder_}};
  LiveIngest ingest_;
};

TEST_F(LiveIngestTest, ColourGetsTheNewestDepthBeforeIt) {
  SendDepth(0, 1000);
  SendDepth(1, 81'000);
  SendDepth(2, 161'000);
  SendColor(0, 100'000);
  const auto frame = Newest();
  ASSERT_TRUE(frame->depth);
  EXPECT_EQ(frame->depth->sequence, 1);
  EXPECT_EQ(frame->capture_us - frame->depth->capture_us, 19'000);
}

TEST_F(LiveIngestTest, StaleDepthIsNoDepth) {
  SendDepth(0, 1000);
  SendColor(0, 5'000'000);
  EXPECT_FALSE(Newest()->depth);
}

TEST_F(LiveIngestTest, GapsInTheSequenceAreLostPicturesAndKeepTheirNumber) {
  SendColor(10, 0);
  StatusAt(70'000);
  EXPECT_EQ(Newest()->frame, 0);
  SendColor(13, 100'000);
  StatusAt(170'000);
  EXPECT_EQ(Newest()->frame, 3);
  EXPECT_EQ(ingest_.Status().drops.at("lost"), 2);
}

TEST_F(LiveIngestTest, AFrameNobodyTookIsLate) {
  SendColor(0, 0);
  SendColor(1, 33'000);
  EXPECT_EQ(Newest()->frame, 1);
  EXPECT_EQ(ingest_.Status().drops.at("late"), 1);
}

TEST_F(LiveIngestTest, ASecondAgentIsIgnoredUntilTheFirstFallsSilent) {
  SendColor(0, 0);
  Newest();
  SendColor(0, 100'000, 8);
  EXPECT_EQ(ingest_.Status().drops.at("other_agent"), 1);
  SendColor(1, 2'000'000, 8);
  EXPECT_EQ(Newest()->epoch, 8);
}

TEST_F(LiveIngestTest, LossRepairAndDelayAreToldPerAgent) {
  mixstage_lcm::agent_health_t health{};
  health.epoch = 7;
  ingest_.OnHealth(health, 0);
  EXPECT_EQ(ingest_.epochs_heard(), 1);
  std::int64_t now_us = 0;
  for (std::int64_t n = 0; n < 200; ++n) {
    EncodedFrame frame{.epoch = 7, .t_us = n * 33'000, .sequence = n, .width = 16, .height = 16, .bytes = {}};
    frame.bytes.assign(19 * 1280, 1);
    now_us = frame.t_us + (n % 3 == 0 ? 1'000 : 5'000);  // every third is the fastest
    // One of 20 slices is lost: of the data where the number is even.
    CutIntoSlices(frame, [&](const mixstage_lcm::frame_slice_t& s) {
      if (s.slice != (n % 2 == 0 ? 3 : 19)) ingest_.OnSlice(s, now_us);
    });
  }
  const AgentStatus agent = StatusAt(now_us + 1'000'000).agents.at(0);
  EXPECT_EQ(agent.repaired, 100);
  EXPECT_NEAR(agent.slice_loss, 0.05, 1e-3);
  EXPECT_NEAR(agent.delay_ms, 4, 1e-9);
}

TEST_F(LiveIngestTest, PicturesOfAnotherSizeAreCountedDrops) {
  SendDepth(0, 0, 9);
  EXPECT_EQ(ingest_.Status().drops.at("depth_size_not_rig"), 1);
  EncodedFrame frame{.epoch = 7, .t_us = 5, .sequence = 0, .width = 16, .height = 16, .bytes = {1, 2, 3}};
  Send(frame, 10);
  EXPECT_EQ(ingest_.Status().drops.at("bad_jpeg"), 1);
}

TEST_F(LiveIngestTest, ARecordingPlaysAsTheShowSawIt) {
  ASSERT_TRUE(recorder_.Start());
  std::vector<std::shared_ptr<const CapturedFrame>> live;
  for (int i = 0; i < 5; ++i) {
    SendDepth(i, 1'000'000 + 80'000 * i);
    SendDepth(i, 1'000'000 + 80'000 * i, 9);  // of another camera: not of this take
    SendColor(i, 1'010'000 + 80'000 * i);
    live.push_back(Newest());
  }
  recorder_.Stop();
  const auto take = OpenTake(folder_);
  ASSERT_TRUE(take) << take.error().message;
  ASSERT_EQ(take->depth.size(), 5u);
  TakeIngest ingest(*take, rig_);
  ASSERT_EQ(ingest.frames(), 5);
  for (int i = 0; i < 5; ++i) {
    std::string warning;
    const auto played = *ingest.Load(i, warning);
    const auto& seen = *live[static_cast<std::size_t>(i)];
    EXPECT_EQ(played->capture_us, seen.capture_us);
    EXPECT_EQ(played->depth->capture_us, seen.depth->capture_us);
    EXPECT_EQ(cv::norm(played->color.y, seen.color.y, cv::NORM_L1), 0);
    EXPECT_EQ(cv::norm(played->depth->counts, seen.depth->counts, cv::NORM_L1), 0);
  }
}

TEST_F(LiveIngestTest, ForgedTimesAndNumbersAreRefused) {
  constexpr std::int64_t kLargest = std::numeric_limits<std::int64_t>::max();
  SendColor(kLargest, 0);
  SendColor(0, std::numeric_limits<std::int64_t>::min());
  SendColor(0, kLargest - kTravelUs);
  EXPECT_EQ(StatusAt(1'000'000).drops.at("bad_slice"), 6) << "a slice of data and one of parity each";
  SendColor(0, 0);
  ingest_.OnHead({.epoch = 7, .t_us = kLargest, .pan_deg = 0, .tilt_deg = 0}, 10);
  EXPECT_EQ(ingest_.Status().drops.at("bad_head"), 1);
  mixstage_lcm::agent_health_t health{};
  health.epoch = 7;
  health.dropped = kLargest;  // no viewer could read it
  ingest_.OnHealth(health, 10);
  EXPECT_EQ(ingest_.Status().drops.at("bad_health"), 1);
}

TEST_F(LiveIngestTest, OneScanIsFollowedToItsEnd) {
  const auto say = [&](std::int64_t epoch, std::int64_t sequence, ScanState state, std::int64_t now_us) {
    auto message = ToMessage({.state = state, .positions = 4});
    message.epoch = epoch;
    message.sequence = sequence;
    ingest_.OnScan(message, now_us);
  };
  EXPECT_FALSE(ingest_.Status().scan);
  say(5, 0, ScanState::kSweep, 1'000'000);
  say(5, 2, ScanState::kCompute, 1'500'000);
  say(5, 1, ScanState::kSweep, 1'600'000);    // late
  say(5, 2, ScanState::kCompute, 1'700'000);  // twice
  say(6, 9, ScanState::kSweep, 2'000'000);    // another's
  EXPECT_EQ(ingest_.Status().scan->progress.state, ScanState::kCompute);
  EXPECT_EQ(ingest_.Status().scan->last_heard_us, 1'500'000);
  EXPECT_EQ(ingest_.Status().drops.at("other_scan"), 1);
  say(6, 10, ScanState::kSweep, 1'500'001 + LiveIngest::kScanSilentUs);
  EXPECT_EQ(ingest_.Status().scan->epoch, 6) << "the first was killed";
  say(6, 11, ScanState::kFailed, 5'000'000);
  say(7, 0, ScanState::kSweep, 5'100'000);
  EXPECT_EQ(ingest_.Status().scan->epoch, 7) << "the second had ended";
  say(0, 1, ScanState::kSweep, 5'200'000);
  EXPECT_EQ(ingest_.Status().drops.at("bad_scan"), 1);
}

TEST_F(LiveIngestTest, AgentsNamesAreMadeHarmless) {
  mixstage_lcm::agent_health_t health{};
  health.epoch = 7;
  const std::string name = "head\"\n\x01";
  std::copy(name.begin(), name.end(), health.name);
  ingest_.OnHealth(health, 5);
  ASSERT_EQ(ingest_.Status().agents.size(), 1u);
  EXPECT_EQ(ingest_.Status().agents[0].name, "head???");
  for (std::int64_t epoch = 1; epoch < 100; ++epoch) {
    health.epoch = epoch;
    ingest_.OnHealth(health, epoch);
  }
  EXPECT_LE(ingest_.Status().agents.size(), 8u);
}

}  // namespace
}  // namespace mixstage
