// SPDX-License-Identifier: Apache-2.0
#include "proto/take/take.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "proto/take/picture_files.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

class TakeTest : public testing::Test {
 protected:
  TakeTest() {
    fs::create_directories(folder_ / "rgb");
    fs::create_directories(folder_ / "depth");
    cv::imwrite((folder_ / "rgb/a.jpg").string(), cv::Mat3b(12, 16, cv::Vec3b(10, 20, 30)));
    cv::imwrite((folder_ / "rgb/b.png").string(), cv::Mat3b(12, 16, cv::Vec3b(40, 50, 60)));
    cv::imwrite((folder_ / "depth/a.png").string(), cv::Mat1w(12, 16, std::uint16_t{1234}));
  }
  ~TakeTest() override { fs::remove_all(folder_); }
  void Write(const char* name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  void ExpectError(const char* word) const {
    const auto take = OpenTake(folder_);
    ASSERT_FALSE(take);
    EXPECT_NE(take.error().message.find(word), std::string::npos) << take.error().message;
    EXPECT_EQ(take.error().code, ErrorCode::kBadInput);
  }

  const fs::path folder_ = fs::temp_directory_path() / ("mixstage_take_" + std::to_string(getpid()));
};

TEST_F(TakeTest, ListsWhatIsThereAndAssumesARigAloud) {
  Write("rgb.txt", "# header\n1.0 rgb/a.jpg\n1.5 rgb/b.png\n");
  Write("depth.txt", "1.0 depth/a.png\n");
  const auto take = OpenTake(folder_);
  ASSERT_TRUE(take) << take.error().message;
  EXPECT_EQ(take->color.size(), 2u);
  EXPECT_EQ(take->color[1].stem(), "b");
  EXPECT_EQ(take->depth.size(), 1u);
  const auto rig = RigOfTake(*take, {});
  ASSERT_TRUE(rig);
  EXPECT_TRUE(rig->rig.registered);
  EXPECT_DOUBLE_EQ(rig->rig.color.fx, 0.9 * 16);
  EXPECT_DOUBLE_EQ(rig->rig.depth->unit_m, 0.001);
  EXPECT_EQ(rig->warnings.size(), 1u);
  EXPECT_DOUBLE_EQ(RigOfTake(*take, {.rig_file = {}, .depth_unit_m = 0.01})->rig.depth->unit_m, 0.01);
}

TEST_F(TakeTest, ABenchmarkFolderPlaysInItsOwnUnit) {
  Write("rgb.txt", "# color images\n# file: 'rgbd_dataset_freiburg1_xyz.bag'\n1.0 rgb/a.jpg\n");
  EXPECT_DOUBLE_EQ(OpenTake(folder_)->assumed_depth_unit_m, 0.0002);
}

TEST_F(TakeTest, MissingFilesAreLeftOutByName) {
  Write("rgb.txt", "1.0 rgb/a.jpg\n2.0 rgb/gone.jpg\n");
  const auto take = OpenTake(folder_);
  ASSERT_TRUE(take);
  EXPECT_EQ(take->color.size(), 1u);
  ASSERT_EQ(take->warnings.size(), 1u);
  EXPECT_NE(take->warnings[0].find("gone.jpg"), std::string::npos);
}

TEST_F(TakeTest, BrokenListsAreErrorsWithTheirLine) {
  ExpectError("rgb.txt");
  Write("rgb.txt", "1.0 rgb/a.jpg\noops\n");
  ExpectError("rgb.txt:2");
  Write("rgb.txt", "2.0 rgb/a.jpg\n1.0 rgb/b.png\n");
  ExpectError("rise");
  Write("rgb.txt", "1.0 ../secret.jpg\n");
  ExpectError("leads out");
  Write("rgb.txt", "1.0 /etc/passwd\n");
  ExpectError("leads out");
  Write("rgb.txt", "1.0 rgb/gone.jpg\n");
  ExpectError("no colour picture");
}

TEST_F(TakeTest, HostileListsAreErrors) {
  // The name ends inside the folder, what the system would open (up to the zero) does not.
  const std::string up_and_down = "../../etc/x" + std::string(1, '\0') + "/../../" +
                                  folder_.parent_path().filename().string() + "/" +
                                  folder_.filename().string();
  Write("rgb.txt", "1.0 " + up_and_down + "/rgb/a.jpg\n");
  ExpectError("leads out");
  Write("rgb.txt", "1.0 rgb/a.jpg " + std::string(100'000, 'x') + "\n");
  ExpectError("rgb.txt:1: is a line of more than");
  Write("rgb.txt", "1.0 rgb/a.jpg\n");
  fs::create_symlink("depth.txt", folder_ / "depth.txt");  // leads to itself
  EXPECT_TRUE(OpenTake(folder_));
}

TEST_F(TakeTest, ACleanPlateMayNameTheTakesOwnPicturesButNoOthers) {
  Write("rgb.txt", "1.0 rgb/a.jpg\n");
  fs::create_directories(folder_ / "clean_plate");
  Write("clean_plate/rgb.txt", "1.0 ../rgb/a.jpg\n");
  const auto plate = OpenTake(folder_ / "clean_plate/");
  ASSERT_TRUE(plate) << plate.error().message;
  EXPECT_EQ(plate->color.size(), 1u);
  Write("clean_plate/rgb.txt", "1.0 ../../elsewhere.jpg\n");
  EXPECT_FALSE(OpenTake(folder_ / "clean_plate"));
}

TEST_F(TakeTest, ARigOfAnotherSizeIsRefused) {
  Write("rgb.txt", "1.0 rgb/a.jpg\n");
  Write(
      "rig.json",
      R"({"version": 1, "cameras": {"color": {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 1, "cy": 1}}})");
  const auto rig = RigOfTake(*OpenTake(folder_), {});
  ASSERT_FALSE(rig);
  EXPECT_NE(rig.error().message.find("640 x 480"), std::string::npos);
}

TEST_F(TakeTest, PicturesPassAGate) {
  JpegDecoder decoder;
  YuvImage image;
  ASSERT_TRUE(LoadColor(folder_ / "rgb/b.png", decoder, image));
  EXPECT_EQ(image.layout, ChromaLayout::k444);
  cv::Mat1w depth;
  ASSERT_TRUE(LoadDepth16(folder_ / "depth/a.png", depth));
  EXPECT_EQ(depth(3, 3), 1234);
  EXPECT_FALSE(LoadDepth16(folder_ / "rgb/b.png", depth));  // 8 bit
  auto bytes = *ReadFileBytes(folder_ / "depth/a.png", 1 << 20);
  bytes[16] = 0x7F;  // a width of two thousand million
  std::ofstream(folder_ / "bomb.png", std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const Status bomb = LoadDepth16(folder_ / "bomb.png", depth);
  ASSERT_FALSE(bomb);
  EXPECT_NE(bomb.error().message.find("over the limit"), std::string::npos) << bomb.error().message;
  bytes[12] = 'x';  // a first chunk that a decoder skips, and with it our idea of the size
  std::ofstream(folder_ / "bomb.png", std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  EXPECT_NE(LoadDepth16(folder_ / "bomb.png", depth).error().message.find("neither"), std::string::npos);
}

}  // namespace
}  // namespace mixstage
