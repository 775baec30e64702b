// SPDX-License-Identifier: Apache-2.0
#include "server/environment/environment_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

namespace mixstage {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A folder of this test alone, gone with it.
struct TempFolder {
  fs::path place =
      fs::path(testing::TempDir()) /
      (std::string("environment_") + testing::UnitTest::GetInstance()->current_test_info()->name());
  TempFolder() { fs::remove_all(place); }
  ~TempFolder() { fs::remove_all(place); }
};

Environment SomeRoom() {
  Environment e;
  e.rig = AssumedRig(640, 480, 0.001);
  e.rig.ptu = PanTilt{};
  e.rig.ptu->T_world_base.translation() << 0.1, -0.2, 1.4;
  e.rig.vignetting_a = -0.16;
  RigidTransform T = RigidTransform::Identity();
  T.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  T.translation() << 1.0 / 3, 2, -1;
  e.frames = {{"0000", RigidTransform::Identity()}, {"0001", T}};
  e.panorama = {.shape = PanoramaShape::kCylindrical,
                .width = 40,
                .height = 30,
                .center = {0.1, 0.2, 1.5},
                .azimuth_left_deg = 60,
                .azimuth_right_deg = -60,
                .elevation_top_deg = 50,
                .elevation_bottom_deg = -50};
  e.planes = {{"floor", PlaneKind::kFloor, Eigen::Vector3d::UnitZ(), 0, {{0, 0, 0}, {4, 0, 0}, {4, 3, 0}}},
              {"back", PlaneKind::kWall, -Eigen::Vector3d::UnitX(), 4, {}}};
  e.lamps = {{"lamp 1", {1, 0, 2.5}, {0.6, 0, 0}, {0, 0.3, 0}, {1, 0.9, 0.8}, 17.5}};
  e.coverage = 0.993;
  e.depth_sigma_m = 0.004;
  e.registration_px = 0.31;
  return e;
}

std::string WhyRefused(const std::function<void(Json&)>& damage) {
  Json json = Json::parse(FormatEnvironment(SomeRoom()));
  damage(json);
  const auto parsed = ParseEnvironment(json.dump());
  return parsed ? "accepted" : parsed.error().message;
}

TEST(Environment, ReadsBackWhatItWrote) {
  const Environment in = SomeRoom();
  const auto parsed = ParseEnvironment(FormatEnvironment(in));
  ASSERT_TRUE(parsed) << parsed.error().message;
  const Environment& out = parsed->environment;
  EXPECT_TRUE(parsed->warnings.empty());
  EXPECT_EQ(out.rig.color, in.rig.color);
  EXPECT_EQ(out.rig.vignetting_a, in.rig.vignetting_a);
  ASSERT_TRUE(out.rig.ptu);
  EXPECT_EQ(out.panorama, in.panorama);
  ASSERT_EQ(out.frames.size(), 2u);
  EXPECT_EQ(out.frames[1].name, "0001");
  EXPECT_TRUE(out.frames[1].T_world_color.isApprox(in.frames[1].T_world_color, 1e-12));
  ASSERT_EQ(out.planes.size(), 2u);
  EXPECT_EQ(out.planes[0].kind, PlaneKind::kFloor);
  EXPECT_EQ(out.planes[0].polygon, in.planes[0].polygon);
  EXPECT_EQ(out.planes[1].normal, in.planes[1].normal);
  EXPECT_EQ(out.planes[1].d, 4);
  ASSERT_EQ(out.lamps.size(), 1u);
  EXPECT_EQ(out.lamps[0].edge_v, in.lamps[0].edge_v);
  EXPECT_EQ(out.lamps[0].intensity, 17.5);
  EXPECT_EQ(out.coverage, in.coverage);
  EXPECT_EQ(out.depth_sigma_m, in.depth_sigma_m);
  EXPECT_EQ(out.registration_px, in.registration_px);
}

TEST(Environment, NamesTheFieldThatIsWrong) {
  using testing::HasSubstr;
  EXPECT_THAT(WhyRefused([](Json& j) { j["version"] = 2; }), HasSubstr("version"));
  EXPECT_THAT(WhyRefused([](Json& j) { j.erase("rig"); }), HasSubstr("rig is missing"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["rig"]["cameras"]["color"]["fx"] = -1; }), HasSubstr("color.fx"));
  EXPECT_THAT(WhyRefused([](Json& j) { j.erase("panorama"); }), HasSubstr("panorama is missing"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["panorama"]["width"] = 100'000; }), HasSubstr("panorama.width"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["panorama"]["projection"] = "flat"; }), HasSubstr("projection"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["panorama"]["azimuth_left_deg"] = -61; }), HasSubstr("azimuth"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["panorama"]["elevation_top_deg"] = 85; }), HasSubstr("elevation"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["frames"][1].erase("T_world_color"); }),
              HasSubstr("frames[1].T_world_color"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["frames"][1]["T_world_color"][0] = 2; }), HasSubstr("frames[1]"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["planes"][0]["n"] = {0, 0, 2}; }), HasSubstr("planes[0].n"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["planes"][1]["kind"] = "sky"; }), HasSubstr("planes[1].kind"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["planes"][0]["polygon"][2] = {0, 0}; }), HasSubstr("polygon"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["planes"][0]["d"] = "0"; }), HasSubstr("planes[0].d"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["lamps"][0]["edge_v"] = j["lamps"][0]["edge_u"]; }),
              HasSubstr("lamps[0].edge_v"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["lamps"][0]["color"] = {1, -1, 1}; }), HasSubstr("lamps[0].color"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["lamps"] = Json(std::vector<Json>(300, j["lamps"][0])); }),
              HasSubstr("lamps is not a list of at most 256"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["coverage"] = 1.5; }), HasSubstr("coverage"));
  EXPECT_THAT(WhyRefused([](Json& j) { j["depth_sigma_m"] = nullptr; }), HasSubstr("depth_sigma_m"));
  EXPECT_FALSE(ParseEnvironment("[]"));
  EXPECT_FALSE(ParseEnvironment(FormatEnvironment(SomeRoom()).substr(0, 500)));
}

TEST(Environment, WarnsOfUnknownKeys) {
  Json json = Json::parse(FormatEnvironment(SomeRoom()));
  json["lamps"][0]["colour"] = "red";
  const auto parsed = ParseEnvironment(json.dump());
  ASSERT_TRUE(parsed);
  ASSERT_EQ(parsed->warnings.size(), 1u);
  EXPECT_THAT(parsed->warnings[0], testing::HasSubstr("lamps[0].colour"));
}

TEST(EnvironmentFolder, KeepsPanoramaBitForBit) {
  const TempFolder folder;
  const Environment room = SomeRoom();
  PanoramaPictures in{cv::Mat4b(30, 40), cv::Mat1w(30, 40)};
  cv::randu(in.color_bgra, 0, 256);
  cv::randu(in.range_mm, 0, 65536);
  ASSERT_TRUE(WriteEnvironment(folder.place, room));
  ASSERT_TRUE(WritePanorama(folder.place, room.panorama, in));
  ASSERT_TRUE(ReadEnvironment(folder.place));
  const auto out = ReadPanorama(folder.place, room.panorama);
  ASSERT_TRUE(out) << out.error().message;
  EXPECT_EQ(cv::norm(out->color_bgra, in.color_bgra, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(out->range_mm, in.range_mm, cv::NORM_INF), 0);

  Panorama other = room.panorama;
  other.width = 41;
  const auto wrong = ReadPanorama(folder.place, other);
  ASSERT_FALSE(wrong);
  EXPECT_THAT(wrong.error().message, testing::HasSubstr("panorama_color.png: is 40 x 30 px"));
  std::ofstream(folder.place / "panorama_depth.png") << "no picture";
  EXPECT_FALSE(ReadPanorama(folder.place, room.panorama));
}

TEST(EnvironmentFolder, SaysWhichFileIsMissing) {
  const auto read = ReadEnvironment("/nonexistent");
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(read.error().message, testing::HasSubstr("environment.json"));
}

TEST(RoomModel, RefusesWhatCannotBeDrawn) {
  RoomModel good;
  good.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  good.uvs = {{0, 0}, {1, 0}, {0, 1}};
  good.indices = {0, 1, 2};
  good.texture_bgr = cv::Mat3b(4, 4);
  EXPECT_TRUE(good.Validate());
  RoomModel bad = good;
  bad.indices[2] = 3;
  EXPECT_FALSE(bad.Validate());
  bad = good;
  bad.positions[0].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(bad.Validate());
  bad = good;
  bad.uvs.pop_back();
  EXPECT_FALSE(bad.Validate());
  bad = good;
  bad.texture_bgr.release();
  EXPECT_FALSE(bad.Validate());
}

}  // namespace
}  // namespace mixstage
