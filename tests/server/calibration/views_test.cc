// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/views.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace mixstage {
namespace {

namespace fs = std::filesystem;

class Views : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    Write("board.json", R"({"inner_corners": [9, 6], "square_m": 0.07})");
  }
  void Write(const std::string& name, const std::string& text) {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name) << text;
  }
  // A list whose files hold something.
  void List(const std::string& list, std::initializer_list<double> times) {
    std::string text;
    for (double t : times) {
      const std::string file = list + "/" + std::to_string(static_cast<int>(t * 1000)) + ".png";
      Write(file, "x");
      text += std::to_string(t) + " " + file + "\n";
    }
    Write(list + ".txt", text);
  }
  fs::path folder_;
};

TEST_F(Views, PicturesOfOneInstantAreOneView) {
  List("rgb", {1.0, 3.0});
  List("fisheye", {1.004, 5.0});
  List("amplitude", {0.98, 3.03});
  List("depth", {0.98, 3.03});
  Write("ptu.txt", "1.0 10 -5\n3.0 20 5\n");
  const auto opened = OpenViewFolder(folder_, 0.015, 0);
  ASSERT_TRUE(opened) << opened.error().message;
  ASSERT_EQ(opened->views.size(), 3u);
  const auto& v = opened->views;
  EXPECT_TRUE(v[0].color && v[0].fisheye && v[0].amplitude && v[0].depth && v[0].head);
  EXPECT_EQ(v[0].head->pan_deg, 10);
  EXPECT_TRUE(v[1].color && v[1].depth && !v[1].fisheye);
  EXPECT_TRUE(!v[2].color && v[2].fisheye && !v[2].head);
}

TEST_F(Views, AFisheyeAloneIsEnough) {
  List("fisheye", {1.0, 2.0});
  const auto opened = OpenViewFolder(folder_, 0, 0);
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(opened->views.size(), 2u);
}

TEST_F(Views, AnUnusableBoardIsNamed) {
  List("rgb", {1.0});
  for (const char* bad :
       {R"({"inner_corners": [9], "square_m": 0.07})", R"({"inner_corners": [9, 6], "square_m": -1})",
        R"({"inner_corners": [9, 6]})", R"({"pattern": "dots", "inner_corners": [9, 6], "square_m": 1})",
        R"([{"inner_corners": [9, 6], "square_m": 1}, {"inner_corners": [6, 9], "square_m": 1}])",
        R"({"inner_corners": [9, 1000], "square_m": 0.07})", "[]", "{"}) {
    Write("board.json", bad);
    const auto opened = OpenViewFolder(folder_, 0, 0);
    ASSERT_FALSE(opened) << bad;
    EXPECT_EQ(opened.error().code, ErrorCode::kBadInput);
    EXPECT_NE(opened.error().message.find("board.json"), std::string::npos);
  }
}

}  // namespace
}  // namespace mixstage
