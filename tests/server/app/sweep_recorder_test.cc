// SPDX-License-Identifier: Apache-2.0
//
// The sweep against a head, cameras and a network of its own: everything on one simulated clock.
#include "server/app/sweep_recorder.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <functional>

#include "capture_agent/head/synthetic_head.h"
#include "proto/take/picture_files.h"
#include "proto/take/take.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr int kColorWidth = 32, kColorHeight = 24, kDepthWidth = 16, kDepthHeight = 12;

Rig TinyRig() {
  Rig rig = AssumedRig(kColorWidth, kColorHeight, 0.00025);
  rig.registered = false;
  rig.depth.emplace();
  rig.depth->camera = rig.color;
  rig.depth->camera.width = kDepthWidth;
  rig.depth->camera.height = kDepthHeight;
  rig.ptu.emplace();
  return rig;
}

// Depth counts say where the head was when they were exposed.
std::uint16_t CountsAt(double pan_deg) {
  return static_cast<std::uint16_t>(std::lround(20'000 + 100 * pan_deg));
}

class SweepTest : public testing::Test {
 protected:
  SweepTest() : folder_(fs::path(testing::TempDir()) / ("sweep_test_" + std::to_string(getpid()))) {
    fs::remove_all(folder_);
  }
  ~SweepTest() override { fs::remove_all(folder_); }

  SweepRecorder Recorder(std::vector<HeadPosition> positions) {
    return {TinyRig(), std::move(positions), TakeWriter::Create({.folder = folder_}).value()};
  }

  EncodedFrame Picture(Stream stream) {
    EncodedFrame frame;
    frame.epoch = epoch_;
    frame.t_us = now_us_ + clock_offset_us_;
    frame.stream = stream;
    if (stream == Stream::kColor) {
      YuvImage image;
      image.Create(kColorWidth, kColorHeight, ChromaLayout::k420);
      image.y = 90;
      image.cb = image.cr = 128;
      EXPECT_TRUE(jpeg_.Encode(image, 90, frame.bytes));
    } else {
      cv::Mat1w counts(kDepthHeight, kDepthWidth, CountsAt(head_.At(now_us_).pan_deg));
      depth_.Encode(View(counts), frame.bytes);
    }
    return frame;
  }

  // Lets time pass until the sweep ends, at most `seconds`. each_ms: called at every millisecond.
  Status Run(
      SweepRecorder& sweep, double seconds, const std::function<void()>& each_ms = [] {}) {
    const std::int64_t end_us = now_us_ + std::llround(seconds * 1e6);
    for (; now_us_ < end_us && !sweep.done(); now_us_ += 1'000) {
      each_ms();
      const std::int64_t ms = now_us_ / 1'000;
      if (agent_runs_) {
        if (ms % 20 == 0) sweep.OnHead(Angles(), now_us_);
        if (ms % 33 == 0) sweep.OnPicture(Picture(Stream::kColor), now_us_);
        if (ms % 80 == 7) {
          sweep.OnPicture(Picture(Stream::kDepth), now_us_);
          sweep.OnPicture(Picture(Stream::kAmplitude), now_us_);
        }
      }
      auto command = sweep.Poll(now_us_);
      for (std::string& line : sweep.TakeNews()) news_.push_back(std::move(line));
      if (!command) return tl::unexpected(command.error());
      if (*command) {
        ++commands_;
        const bool arrives = !lose_command_ || !lose_command_(commands_);
        if (arrives) (void)head_.MoveToAt(now_us_, (*command)->pan_deg, (*command)->tilt_deg);
      }
    }
    return {};
  }

  mixstage_lcm::head_angles_t Angles() {
    const HeadReading at = head_.At(now_us_);
    noise_ = -noise_;
    return {.epoch = epoch_,
            .t_us = now_us_ + clock_offset_us_,
            .pan_deg = at.pan_deg + noise_,
            .tilt_deg = at.tilt_deg + noise_};
  }

  // Every position that was recorded, with pictures of the head at rest there and nowhere else.
  void ExpectRecorded(const std::vector<HeadPosition>& positions) {
    const auto take = OpenTake(folder_);
    ASSERT_TRUE(take) << take.error().message;
    ASSERT_EQ(take->color.size(), positions.size());
    ASSERT_EQ(take->head.size(), positions.size());
    ASSERT_EQ(take->depth.size(), 3 * positions.size());
    ASSERT_EQ(take->amplitude.size(), 3 * positions.size());
    for (std::size_t i = 0; i < positions.size(); ++i) {
      EXPECT_NEAR(take->head[i].pan_deg, positions[i].pan_deg, 0.003);
      EXPECT_NEAR(take->head[i].tilt_deg, positions[i].tilt_deg, 0.003);
      EXPECT_EQ(take->head[i].t_s, take->color[i].t_s);
      for (std::size_t k = 3 * i; k < 3 * i + 3; ++k) {
        cv::Mat1w counts;
        ASSERT_TRUE(LoadDepth16(take->depth[k].file, counts));
        EXPECT_EQ(counts(3, 3), CountsAt(positions[i].pan_deg));
        EXPECT_LT(std::abs(take->depth[k].t_s - take->color[i].t_s), 0.4);
      }
    }
  }

  const fs::path folder_;
  std::int64_t now_us_ = 1'000'000'000, clock_offset_us_ = 77'000'000, epoch_ = 5;
  bool agent_runs_ = true;
  int commands_ = 0;
  double noise_ = 0.01;
  std::function<bool(int)> lose_command_;
  SyntheticHead head_;
  JpegEncoder jpeg_;
  DepthEncoder depth_;
  std::vector<std::string> news_;
};

const std::vector<HeadPosition> kPlaces = {{-30, 12}, {0, 12}, {30, 12}, {30, -8}, {0, -8}};

TEST_F(SweepTest, RecordsEveryPositionAtRestAndSendsTheHeadBack) {
  ASSERT_TRUE(head_.MoveToAt(1, 3, -1));
  SweepRecorder sweep = Recorder(kPlaces);
  const std::int64_t begun_us = now_us_;
  ASSERT_TRUE(Run(sweep, 60));
  ASSERT_TRUE(sweep.done());
  EXPECT_EQ(sweep.recorded(), 5);
  EXPECT_LT(static_cast<double>(now_us_ - begun_us) * 1e-6, 9)
      << "moves of 30 degrees and 0.4 s at each place";
  ExpectRecorded(kPlaces);
  EXPECT_EQ(news_.size(), 5u);
  const HeadReading home = head_.At(now_us_ + 10'000'000);
  EXPECT_NEAR(home.pan_deg, 3, 0.02);
  EXPECT_NEAR(home.tilt_deg, -1, 0.02);
}

TEST_F(SweepTest, ACommandThatIsLostIsSentAgain) {
  lose_command_ = [](int number) { return number % 2 == 1; };
  SweepRecorder sweep = Recorder(kPlaces);
  ASSERT_TRUE(Run(sweep, 60));
  EXPECT_EQ(sweep.recorded(), 5);
  ExpectRecorded(kPlaces);
}

TEST_F(SweepTest, WhereTheHeadDoesNotGoIsLeftOutByName) {
  std::vector<HeadPosition> places = kPlaces;
  places.insert(places.begin() + 1, {170, 12});
  SweepRecorder sweep = Recorder(places);
  ASSERT_TRUE(Run(sweep, 60));
  EXPECT_EQ(sweep.recorded(), 5);
  ExpectRecorded(kPlaces);
  ASSERT_EQ(news_.size(), 6u);
  EXPECT_NE(news_[1].find("position 2 of 6 is left out: pan 170.0"), std::string::npos) << news_[1];
  const ScanProgress progress = sweep.Progress();
  EXPECT_EQ(progress.recorded, 5);
  EXPECT_EQ(progress.left_out, 1);
  EXPECT_NE(progress.notes.find("pan 170.0 tilt 12.0: the head does not go there"), std::string::npos)
      << progress.notes;
  EXPECT_TRUE(progress.map.cells.empty()) << "these positions are no grid";
}

TEST_F(SweepTest, TheMapFillsAsTheHeadSeesIt) {
  using enum SweepCell;
  SweepRecorder sweep = Recorder({{-30, 12}, {0, 12}, {170, 12}, {170, -8}, {0, -8}, {-30, -8}});
  EXPECT_EQ(sweep.Progress().map.cells, std::vector<SweepCell>(6, kToCome)) << "no head was heard of";
  bool seen = false;
  ASSERT_TRUE(Run(sweep, 80, [&] {
    if (seen || sweep.recorded() < 2) return;
    seen = true;
    EXPECT_EQ(sweep.Progress().map.cells,
              (std::vector<SweepCell>{kHead, kRecorded, kRecorded, kToCome, kToCome, kToCome}));
  }));
  EXPECT_TRUE(seen);
  const SweepMap map = sweep.Progress().map;
  EXPECT_EQ(map.columns, 3);
  EXPECT_EQ(map.rows, 2);
  EXPECT_EQ(map.pan_deg, (std::array<float, 2>{170, -30}));
  EXPECT_EQ(map.tilt_deg, (std::array<float, 2>{12, -8}));
  EXPECT_EQ(map.cells,
            (std::vector<SweepCell>{kLeftOut, kRecorded, kRecorded, kLeftOut, kRecorded, kRecorded}));
}

TEST_F(SweepTest, WithoutAnAgentEndsSoonAndSaysSo) {
  agent_runs_ = false;
  SweepRecorder sweep = Recorder(kPlaces);
  const Status run = Run(sweep, 60);
  ASSERT_FALSE(run);
  EXPECT_EQ(run.error().code, ErrorCode::kUnavailable);
  EXPECT_NE(run.error().message.find("no agent"), std::string::npos);
}

TEST_F(SweepTest, NothingThatTheNetworkInventsIsRecorded) {
  SweepRecorder sweep = Recorder(kPlaces);
  int step = 0;
  ASSERT_TRUE(Run(sweep, 60, [&] {
    if (++step < 40 || step % 10 != 0) return;
    for (const double angle : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
      auto bad = Angles();
      bad.pan_deg = angle;
      sweep.OnHead(bad, now_us_);
    }
    auto late = Angles();
    late.t_us = std::int64_t{1} << 62;
    sweep.OnHead(late, now_us_);
    auto other = Angles();
    other.epoch = 99;
    other.pan_deg = 55;
    sweep.OnHead(other, now_us_);
    EncodedFrame large = Picture(Stream::kColor);
    YuvImage image;
    image.Create(640, 480, ChromaLayout::k420);
    ASSERT_TRUE(jpeg_.Encode(image, 50, large.bytes));
    sweep.OnPicture(large, now_us_);
    EncodedFrame junk = Picture(Stream::kDepth);
    junk.bytes.resize(junk.bytes.size() / 2);
    sweep.OnPicture(junk, now_us_);
    EncodedFrame foreign = Picture(Stream::kDepth);
    foreign.epoch = 99;
    sweep.OnPicture(foreign, now_us_);
  }));
  EXPECT_EQ(sweep.recorded(), 5);
  ExpectRecorded(kPlaces);
}

TEST_F(SweepTest, AnAgentThatStartsAgainWithAnotherClockGoesOn) {
  SweepRecorder sweep = Recorder(kPlaces);
  ASSERT_TRUE(Run(sweep, 3));
  ASSERT_FALSE(sweep.done());
  agent_runs_ = false;
  ASSERT_TRUE(Run(sweep, 4));
  agent_runs_ = true;
  epoch_ = 6;
  clock_offset_us_ = -900'000'000;
  ASSERT_TRUE(head_.MoveToAt(now_us_, 0, 0));
  ASSERT_TRUE(Run(sweep, 60));
  EXPECT_EQ(sweep.recorded(), 5);
  ExpectRecorded(kPlaces);
}

TEST_F(SweepTest, PicturesOfAHeadThatIsPushedAreForgotten) {
  SweepRecorder sweep = Recorder(kPlaces);
  bool pushed = false;
  ASSERT_TRUE(Run(sweep, 60, [&] {
    // Half a degree off, just when it has come to rest at the first place.
    if (!pushed && head_.At(now_us_).pan_deg == -30 && now_us_ > head_.settles_us() + 100'000) {
      pushed = true;
      ASSERT_TRUE(head_.MoveToAt(now_us_, -30.6, 12));
    }
  }));
  EXPECT_TRUE(pushed);
  EXPECT_EQ(sweep.recorded(), 5);
  ExpectRecorded(kPlaces);
}

}  // namespace
}  // namespace mixstage
