// SPDX-License-Identifier: Apache-2.0
#include "proto/take/take_writer.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <thread>

#include "proto/take/picture_files.h"
#include "proto/take/take.h"
#include "proto/take/take_recorder.h"
#include "server/ingest/take_ingest.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kHourUs = 3'600'000'000;

bool Eventually(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

class TakeWriterTest : public testing::Test {
 protected:
  TakeWriterTest() { fs::remove_all(folder_); }
  ~TakeWriterTest() override {
    fs::remove_all(folder_);
    fs::remove_all(folder_.string() + "-2");
  }
  static std::vector<std::uint8_t> Jpeg(int luma) {
    std::vector<std::uint8_t> bytes;
    EXPECT_TRUE(JpegEncoder().Encode(Planes(luma), 90, bytes));
    return bytes;
  }
  static YuvImage Planes(int luma) {
    YuvImage image;
    image.Create(16, 12, ChromaLayout::k420);
    image.y.setTo(luma);
    image.cb.setTo(128);
    image.cr.setTo(128);
    return image;
  }
  static cv::Mat1w Counts(int seed) {
    cv::Mat1w counts(12, 16);
    for (int i = 0; i < 12 * 16; ++i) counts(i / 16, i % 16) = static_cast<std::uint16_t>(i * 331 + seed);
    return counts;
  }
  [[nodiscard]] std::size_t Listed(const char* list) const {
    std::ifstream in(folder_ / list);
    std::size_t lines = 0;
    for (std::string line; std::getline(in, line);) lines += line.empty() || line[0] != '#';
    return lines;
  }

  const fs::path folder_ = fs::temp_directory_path() / ("mixstage_take_writer_" + std::to_string(getpid()));
};

TEST_F(TakeWriterTest, WhatIsWrittenComesBackByteForByteAndToTheMicrosecond) {
  {
    auto writer = TakeWriter::Create({.folder = folder_});
    ASSERT_TRUE(writer) << writer.error().message;
    for (int i = 0; i < 3; ++i) {
      const std::int64_t t_us = 100 * kHourUs + 33'333 * i + 1;
      EXPECT_EQ(*writer->WritePicture(TakeList::kDepth, t_us, Counts(i)), TakeWrite::kWritten);
      EXPECT_EQ(*writer->WritePicture(TakeList::kAmplitude, t_us, Counts(50 + i)), TakeWrite::kWritten);
      EXPECT_EQ(*writer->WritePicture(TakeList::kColor, t_us + 7, Jpeg(40 * i)), TakeWrite::kWritten);
      EXPECT_EQ(*writer->WritePicture(TakeList::kFisheye, t_us + 9, Jpeg(i)), TakeWrite::kWritten);
      EXPECT_EQ(*writer->WriteHead(t_us, 12.5 * i, -3.25), TakeWrite::kWritten);
    }
    EXPECT_TRUE(writer->Sync());
  }
  const auto take = OpenTake(folder_);
  ASSERT_TRUE(take) << take.error().message;
  EXPECT_TRUE(take->warnings.empty());
  ASSERT_EQ(take->color.size(), 3u);
  EXPECT_EQ(take->fisheye.size(), 3u);
  EXPECT_EQ(*ReadFileBytes(take->color[2].file, 1 << 20), Jpeg(80));
  EXPECT_EQ(take->color[2].stem(), "0000002");
  ASSERT_EQ(take->head.size(), 3u);
  EXPECT_EQ(take->head[1].pan_deg, 12.5);
  EXPECT_EQ(take->head[1].tilt_deg, -3.25);
  Rig rig = AssumedRig(16, 12, 0.001);
  TakeIngest ingest(*take, rig);
  for (int i = 0; i < 3; ++i) {
    std::string warning;
    const auto frame = ingest.Load(i, warning);
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_EQ((*frame)->capture_us, 100 * kHourUs + 33'333 * i + 8);
    ASSERT_TRUE((*frame)->depth);
    EXPECT_EQ((*frame)->depth->capture_us, 100 * kHourUs + 33'333 * i + 1);
    EXPECT_EQ(cv::norm((*frame)->depth->counts, Counts(i), cv::NORM_L1), 0);
    EXPECT_EQ(cv::norm((*frame)->depth->amplitude, Counts(50 + i), cv::NORM_L1), 0);
  }
}

TEST_F(TakeWriterTest, PlanesBecomeAPictureFile) {
  auto writer = TakeWriter::Create({.folder = folder_, .planes_as = PlanesAs::kPng});
  ASSERT_TRUE(writer);
  ASSERT_TRUE(writer->WritePicture(TakeList::kColor, 5, Planes(77)));
  JpegDecoder decoder;
  YuvImage image;
  ASSERT_TRUE(LoadColor(folder_ / "rgb/0000000.png", decoder, image));
  EXPECT_EQ(image.y(3, 3), 77);
}

TEST_F(TakeWriterTest, ATakeIsNeverOverwritten) {
  ASSERT_TRUE(TakeWriter::Create({.folder = folder_}));
  const auto again = TakeWriter::Create({.folder = folder_});
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kInvalidConfig);
  EXPECT_NE(again.error().message.find("rgb.txt"), std::string::npos);
}

TEST_F(TakeWriterTest, TheRigLiesBesideTheLists) {
  const fs::path rig = folder_ / "from" / "head.json";
  fs::create_directories(rig.parent_path());
  std::ofstream(rig) << "{}";
  ASSERT_TRUE(TakeWriter::Create({.folder = folder_ / "take", .rig_file = rig}));
  EXPECT_EQ(fs::file_size(folder_ / "take" / "rig.json"), 2u);
  EXPECT_FALSE(TakeWriter::Create({.folder = folder_ / "other", .rig_file = folder_ / "gone.json"}));
}

TEST_F(TakeWriterTest, TimesThatDoNotRiseAreLeftOut) {
  auto writer = TakeWriter::Create({.folder = folder_});
  ASSERT_TRUE(writer);
  for (const auto& [t_us, expected] :
       {std::pair{std::int64_t{10}, TakeWrite::kWritten}, std::pair{std::int64_t{10}, TakeWrite::kLeftOut},
        std::pair{std::int64_t{-1}, TakeWrite::kLeftOut}, std::pair{INT64_MAX, TakeWrite::kLeftOut},
        std::pair{std::int64_t{11}, TakeWrite::kWritten}}) {
    EXPECT_EQ(*writer->WritePicture(TakeList::kColor, t_us, Jpeg(1)), expected) << t_us;
  }
  EXPECT_EQ(OpenTake(folder_)->color.size(), 2u);
}

TEST_F(TakeWriterTest, ATornTailIsLeftOutWithAWarning) {
  {
    auto writer = TakeWriter::Create({.folder = folder_});
    for (int i = 1; i < 4; ++i) {
      ASSERT_TRUE(writer->WritePicture(TakeList::kColor, i, Jpeg(i)));
      ASSERT_TRUE(writer->WriteHead(i, 10 * i, 20.5));
    }
  }
  const auto size = fs::file_size(folder_ / "rgb.txt");
  const auto head_size = fs::file_size(folder_ / "ptu.txt");
  const std::size_t line = std::string("0.000003 rgb/0000002.jpg\n").size();
  for (std::size_t cut = 1; cut < line; ++cut) {  // also in the middle of the time and of the name
    fs::resize_file(folder_ / "rgb.txt", size - cut);
    if (cut < 3) fs::resize_file(folder_ / "ptu.txt", head_size - cut);  // 20. is still a number
    const auto take = OpenTake(folder_);
    ASSERT_TRUE(take) << take.error().message;
    EXPECT_EQ(take->color.size(), cut == 1 ? 3u : 2u) << cut;
    EXPECT_EQ(take->head.size(), 2u);
    EXPECT_EQ(take->warnings.size(), cut == 1 ? 1u : 2u) << cut;
  }
  std::ofstream(folder_ / "rgb.txt", std::ios::app)
      << std::string(100, '\0');  // a block that was never written
  EXPECT_TRUE(OpenTake(folder_));
  fs::resize_file(folder_ / "rgb/0000001.jpg", 0);
  EXPECT_EQ(OpenTake(folder_)->color.size(), 1u);
}

// A limit on the size of files stands in for a full disk: the write ends in the middle.
TEST_F(TakeWriterTest, AFullDiskLeavesAGoodTakeAndAStoppedRecording) {
  TakeRecorder recorder({.folder = folder_});
  ASSERT_TRUE(recorder.Start());
  recorder.Picture(TakeList::kColor, 1, Jpeg(1));
  ASSERT_TRUE(Eventually([&] { return recorder.status().pictures == 1; }));
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto old_handler = signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 4096;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  recorder.Picture(TakeList::kColor, 2, std::vector<std::uint8_t>(100'000, 7));
  const bool stopped = Eventually([&] { return !recorder.status().active; });
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, old_handler);
  EXPECT_TRUE(stopped);
  recorder.Picture(TakeList::kColor, 3, Jpeg(3));  // nobody minds
  recorder.Stop();
  EXPECT_EQ(recorder.status().pictures, 1);
  EXPECT_EQ(recorder.status().dropped, 1);
  EXPECT_EQ(OpenTake(folder_)->color.size(), 1u);
  EXPECT_FALSE(fs::exists(folder_ / "rgb/0000001.jpg"));
}

TEST_F(TakeWriterTest, TheTakePlaysWhileItIsRecorded) {
  TakeRecorder recorder({.folder = folder_});
  ASSERT_TRUE(recorder.Start());
  for (int i = 0; i < 20; ++i) recorder.Picture(TakeList::kColor, i, Jpeg(i));
  // Nothing is stopped or closed: what a kill would leave.
  EXPECT_TRUE(Eventually([&] { return Listed("rgb.txt") == 20; }));
  EXPECT_EQ(OpenTake(folder_)->color.size(), 20u);
  EXPECT_TRUE(recorder.status().active);
}

TEST_F(TakeWriterTest, StopWritesWhatWaitsAndASecondTakeLiesBesideTheFirst) {
  TakeRecorder recorder({.folder = folder_ / ""});
  EXPECT_EQ(recorder.status().seconds, 0);
  recorder.Picture(TakeList::kColor, 0, Jpeg(1));  // nothing runs yet
  ASSERT_TRUE(recorder.Start());
  ASSERT_TRUE(recorder.Start());  // runs already
  for (int i = 0; i < 30; ++i) recorder.Picture(TakeList::kColor, i, Planes(i));
  recorder.Stop();
  recorder.Stop();
  EXPECT_EQ(OpenTake(folder_)->color.size(), 30u);
  EXPECT_EQ(recorder.status().pictures, 30);
  EXPECT_FALSE(recorder.status().active);
  EXPECT_GT(recorder.status().seconds, 0);
  ASSERT_TRUE(recorder.Start());
  recorder.Picture(TakeList::kColor, 5, Jpeg(1));
  recorder.Stop();
  EXPECT_EQ(OpenTake(folder_.string() + "-2")->color.size(), 1u);
  EXPECT_FALSE(TakeRecorder({.folder = folder_}).Start());
}

TEST_F(TakeWriterTest, ASlowDiskCostsTheOldestPicturesAndNobodyWaits) {
  TakeRecorder recorder({.folder = folder_});
  ASSERT_TRUE(recorder.Start());
  // 360 MB at once (one picture, named 20 times) against a queue of 64 MiB: packing one takes longer.
  const cv::Mat1w big(3000, 3000, std::uint16_t{1});
  for (int i = 0; i < 20; ++i) recorder.Picture(TakeList::kDepth, i, big);
  recorder.Picture(TakeList::kColor, 20, Jpeg(1));
  recorder.Stop();
  const RecordingStatus status = recorder.status();
  EXPECT_GT(status.dropped, 0);
  EXPECT_EQ(status.pictures + status.dropped, 21);
  const auto take = OpenTake(folder_);
  EXPECT_EQ(take->depth.size() + 1, static_cast<std::size_t>(status.pictures));
  EXPECT_NEAR(take->depth.back().t_s, 19e-6, 1e-9) << "the newest stay";
}

}  // namespace
}  // namespace mixstage
