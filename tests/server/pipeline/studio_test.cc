// SPDX-License-Identifier: Apache-2.0
//
// The whole chain of frame stages on the synthetic set, whose truth is exact.
#include "server/pipeline/studio.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/pipeline/frame_stages.h"
#include "server/scene/scene_file.h"
#include "server/segmentation/labels.h"

namespace mixstage {
namespace {

class StudioTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    auto scene = SyntheticScene::Create(SyntheticRig(), {});
    ASSERT_TRUE(scene) << scene.error().message;
    synthetic_ = new SyntheticScene(std::move(*scene));
  }
  static void TearDownTestSuite() { delete synthetic_; }

  // Colour at t_s, depth of the newest ToF exposure before it.
  static std::shared_ptr<const CapturedFrame> Capture(double t_s) {
    auto frame = std::make_shared<CapturedFrame>();
    frame->capture_us = std::llround(t_s * 1e6);
    frame->frame = std::llround(t_s * 30);
    synthetic_->RenderColor(t_s, frame->color);
    const double depth_s = std::floor(t_s / 0.08) * 0.08;
    auto depth = std::make_shared<DepthPicture>();
    depth->capture_us = std::llround(depth_s * 1e6);
    depth->sequence = std::llround(depth_s / 0.08);
    synthetic_->RenderTof(depth_s, depth->counts, depth->amplitude);
    frame->depth = depth;
    return frame;
  }
  static Studio MakeStudio(bool with_objects) {
    StudioSetup setup;
    setup.rig = SyntheticRig();
    if (with_objects) {
      auto scene = LoadScene(std::string(MIXSTAGE_SOURCE_DIR) + "/deploy/demo/scene.yaml", LoadModel);
      EXPECT_TRUE(scene) << scene.error().message;
      setup.scene = std::move(scene->scene);
    }
    auto studio = Studio::Create(std::move(setup));
    EXPECT_TRUE(studio);
    return std::move(*studio);
  }
  // The empty set as a scan would have it that saw it from where the camera stands: a grid over its true
  // depth, cut at steps, the picture of an empty moment on it.
  static RoomModel Scan() {
    constexpr int kStep = 3;
    const cv::Mat1f z = synthetic_->TruthDepth(SyntheticCamera::kColor, 0.3);
    YuvImage empty;
    synthetic_->RenderColor(0.3, empty);
    RoomModel room;
    room.texture_bgr = ToBgr(empty);
    const RigidTransform& T_world_color = synthetic_->TruthPose();
    const PinholeCamera& camera = synthetic_->rig().color;
    cv::Mat1i vertex(z.size(), -1);
    for (int v = 0; v < z.rows; v += kStep) {
      for (int u = 0; u < z.cols; u += kStep) {
        const auto ray = camera.Unproject(Eigen::Vector2d(u, v));
        if (!ray || !(z(v, u) > 0)) continue;
        vertex(v, u) = static_cast<int>(room.positions.size());
        const Eigen::Vector3d p = T_world_color * (z(v, u) * Eigen::Vector3d(ray->x(), ray->y(), 1));
        room.positions.push_back(p.cast<float>());
        room.uvs.emplace_back((static_cast<float>(u) + 0.5f) / static_cast<float>(z.cols),
                              (static_cast<float>(v) + 0.5f) / static_cast<float>(z.rows));
      }
    }
    auto add = [&](cv::Point a, cv::Point b, cv::Point c) {
      const auto [near, far] = std::minmax({z(a), z(b), z(c)});
      if (vertex(a) < 0 || vertex(b) < 0 || vertex(c) < 0 || far > 1.05f * near) return;
      for (const cv::Point& p : {a, b, c}) room.indices.push_back(static_cast<std::uint32_t>(vertex(p)));
    };
    for (int v = 0; v + kStep < z.rows; v += kStep) {
      for (int u = 0; u + kStep < z.cols; u += kStep) {
        add({u, v}, {u, v + kStep}, {u + kStep, v});
        add({u + kStep, v}, {u, v + kStep}, {u + kStep, v + kStep});
      }
    }
    return room;
  }
  // Shows the empty set (the figure enters at 3 s) until the room is known.
  static void Learn(Studio& studio) {
    Frame frame;
    for (int i = 0; i < 40 && studio.room_state() != RoomState::kKnown; ++i) {
      frame.captured = Capture(0.3 + i / 30.0);
      studio.Run(frame, times_);
    }
    ASSERT_EQ(studio.room_state(), RoomState::kKnown);
  }

  static SyntheticScene* synthetic_;
  static StageTimes times_;
};
SyntheticScene* StudioTest::synthetic_ = nullptr;
StageTimes StudioTest::times_{0};

TEST_F(StudioTest, LearnsTheEmptySetThenCutsTheFigureOut) {
  Studio studio = MakeStudio(/*with_objects=*/false);
  Learn(studio);
  Frame frame;
  double hit = 0, called = 0, actor = 0;
  for (const double t_s : {8.5, 14.0}) {
    frame.captured = Capture(t_s);
    studio.Run(frame, times_);
    const cv::Mat truth = synthetic_->TruthMatte(t_s) >= 128;
    const cv::Mat mine = frame.alpha >= 128;
    hit += cv::countNonZero(truth & mine);
    called += cv::countNonZero(mine);
    actor += cv::countNonZero(truth);
  }
  EXPECT_GT(2 * hit / (called + actor),
            0.95);  // F; the figure's pale shirt before a pale wall is no easy set
}

TEST_F(StudioTest, TheEmptySetHasNoActor) {
  Studio studio = MakeStudio(/*with_objects=*/false);
  Learn(studio);
  Frame frame;
  frame.captured = Capture(2.5);
  studio.Run(frame, times_);
  EXPECT_LT(cv::countNonZero(frame.alpha >= 128), 20);
}

TEST_F(StudioTest, WhileTheSetIsLearntNobodyIsAnActor) {
  Studio studio = MakeStudio(/*with_objects=*/false);
  Frame frame;
  frame.captured = Capture(0.3);
  studio.Run(frame, times_);
  EXPECT_FALSE(frame.keyed);
  EXPECT_EQ(cv::countNonZero(frame.alpha), 0);
  EXPECT_EQ(cv::countNonZero(frame.composite.y != frame.captured->color.y), 0);
}

TEST_F(StudioTest, CompositeDepthIsTheTruthOfRoomAndFigure) {
  Studio studio = MakeStudio(/*with_objects=*/false);
  Learn(studio);
  Frame frame;
  frame.captured = Capture(14.0);
  studio.Run(frame, times_);
  const cv::Mat1f truth_m = synthetic_->TruthDepth(SyntheticCamera::kColor, 14.0);
  int known = 0;
  int near = 0;
  for (int y = 0; y < truth_m.rows; y += 3) {
    for (int x = 0; x < truth_m.cols; x += 3) {
      if (frame.depth_mm(y, x) == 0) continue;
      ++known;
      near += std::abs(static_cast<float>(frame.depth_mm(y, x)) * 1e-3f - truth_m(y, x)) < 0.1f;
    }
  }
  EXPECT_GT(known, truth_m.rows * truth_m.cols / 9 * 8 / 10);
  EXPECT_GT(near, known * 9 / 10);  // the rest lies beside silhouettes and is noisy beyond 5 m
}

TEST_F(StudioTest, TheFigureHidesOneObjectAndIsHiddenByAnother) {
  Studio studio = MakeStudio(/*with_objects=*/true);
  Learn(studio);
  Frame frame;
  bool hides = false;
  bool hidden = false;
  cv::Mat1b alone;
  for (const double t_s : {2.9, 4.9, 5.3, 5.7, 6.1, 6.5}) {
    frame.captured = Capture(t_s);
    studio.Run(frame, times_);
    if (alone.empty()) alone = frame.cg_alpha.clone();  // he is not there yet
    const cv::Mat truth = synthetic_->TruthMatte(t_s) >= 250;
    hides = hides || cv::countNonZero(truth & (alone == 255) & (frame.cg_alpha == 0)) > 2000;
    hidden = hidden || cv::countNonZero(truth & (frame.cg_alpha == 255)) > 2000;
  }
  EXPECT_TRUE(hides);
  EXPECT_TRUE(hidden);
}

TEST_F(StudioTest, WithoutDepthTheShowGoesOnByColour) {
  Studio studio = MakeStudio(/*with_objects=*/true);
  Learn(studio);
  Frame frame;
  auto captured = std::make_shared<CapturedFrame>(*Capture(8.5));
  captured->depth = nullptr;
  frame.captured = captured;
  studio.Run(frame, times_);
  EXPECT_TRUE(frame.keyed);
  const cv::Mat truth = synthetic_->TruthMatte(8.5) >= 128;
  EXPECT_GT(cv::countNonZero(truth & (frame.alpha >= 128)), cv::countNonZero(truth) * 7 / 10);
}

TEST_F(StudioTest, DepthsWrongClockIsFoundAndMoved) {
  constexpr std::int64_t kWrongUs = 25'000;
  Studio studio = MakeStudio(/*with_objects=*/false);
  Learn(studio);
  Frame frame;
  std::shared_ptr<const DepthPicture> depth;
  for (int i = 0; i < 10 * 30; ++i) {  // he crosses the set, turns and comes back
    const double t_s = 4.5 + i / 30.0;
    auto captured = std::make_shared<CapturedFrame>();
    captured->capture_us = std::llround(t_s * 1e6);
    synthetic_->RenderColor(t_s, captured->color);
    const double depth_s = std::floor(t_s / 0.08 - 0.4) * 0.08;
    const std::int64_t depth_us = std::llround(depth_s * 1e6) + kWrongUs;
    if (!depth || depth->capture_us != depth_us) {
      auto picture = std::make_shared<DepthPicture>();
      picture->capture_us = depth_us;
      synthetic_->RenderTof(depth_s, picture->counts, picture->amplitude);
      depth = picture;
    }
    captured->depth = depth;
    frame.captured = captured;
    studio.Run(frame, times_);
  }
  ASSERT_TRUE(studio.depth_clock());
  EXPECT_NEAR(studio.depth_clock()->offset_s, -1e-6 * kWrongUs, 0.002);
  EXPECT_NEAR(static_cast<double>(studio.depth_clock_applied_us()), -static_cast<double>(kWrongUs), 4000);
}

TEST_F(StudioTest, ADepthPictureOfAnotherSizeIsCountedAndLeftOut) {
  Studio studio = MakeStudio(/*with_objects=*/false);
  auto captured = std::make_shared<CapturedFrame>(*Capture(0.5));
  auto odd = std::make_shared<DepthPicture>();
  odd->counts = cv::Mat1w(10, 10, std::uint16_t{1000});
  captured->depth = odd;
  Frame frame;
  frame.captured = captured;
  studio.Run(frame, times_);
  EXPECT_EQ(studio.unusable_depths(), 1);
  EXPECT_TRUE(frame.D.empty());
}

TEST_F(StudioTest, AScannedRoomNeedsNoEmptySet) {
  StudioSetup setup;
  setup.rig = SyntheticRig();
  setup.rig.vignetting_a = setup.rig.vignetting_b = 0;  // Scan's texture has it
  setup.scanned = ScannedRoom{.model = Scan(), .doubt = {.registration_px = 0.3f, .depth_sigma_m = 0.003f}};
  auto studio = Studio::Create(std::move(setup));
  ASSERT_TRUE(studio) << studio.error().message;
  EXPECT_EQ(studio->room_state(), RoomState::kKnown);
  Frame frame;
  double hit = 0, called = 0, actor = 0;
  for (const double t_s : {8.5, 14.0}) {  // from the first frame on
    frame.captured = Capture(t_s);
    studio->Run(frame, times_);
    EXPECT_TRUE(frame.keyed);
    const cv::Mat truth = synthetic_->TruthMatte(t_s) >= 128;
    const cv::Mat mine = frame.alpha >= 128;
    hit += cv::countNonZero(truth & mine);
    called += cv::countNonZero(mine);
    actor += cv::countNonZero(truth);
  }
  EXPECT_GT(2 * hit / (called + actor), 0.94);
  const cv::Mat1f truth = synthetic_->TruthDepth(SyntheticCamera::kColor, 0.3);
  const cv::Mat1f& D_M = studio->room_view()->Look(frame.T_world_color).depth_m;
  int good = 0;
  for (int i = 0; i < truth.rows * truth.cols; ++i) good += std::abs(truth(i) - D_M(i)) < 0.01f ? 1 : 0;
  EXPECT_GT(good, 0.93 * truth.rows * truth.cols);
  frame.captured = Capture(2.5);
  studio->Run(frame, times_);
  EXPECT_LT(cv::countNonZero(frame.alpha >= 128), 200);
}

TEST_F(StudioTest, AReflectorMayBeASurfaceThatTheScanHasFound) {
  const auto show = [](const std::string& surface) {
    StudioSetup setup;
    setup.rig = SyntheticRig();
    setup.rig.vignetting_a = setup.rig.vignetting_b = 0;
    setup.scanned = ScannedRoom{.model = Scan(), .doubt = {.registration_px = 0.3f, .depth_sigma_m = 0.003f}};
    for (const char* name : {"floor", "wall"}) setup.scanned->planes.emplace_back().name = name;
    auto scene = LoadScene(MIXSTAGE_SOURCE_DIR "/deploy/demo/scene.yaml", LoadModel);
    setup.scene = std::move(scene->scene);
    if (!surface.empty()) {
      Reflector& reflector = setup.scene->reflectors.emplace_back();
      reflector.name = "wet floor";
      reflector.surface = surface;
      reflector.reflectivity = 0.3;
    }
    return Studio::Create(std::move(setup));
  };
  const auto wrong = show("table");
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.error().message,
            "scene: reflector wet floor: surface: \"table\" is no plane of the scanned room, which has "
            "floor, wall");
  auto wet = show("floor"), dry = show("");
  ASSERT_TRUE(wet && dry) << (wet ? dry : wet).error().message;
  wet->SetScene(std::make_shared<const Scene>(*wet->scene()));  // as after an edit
  Frame a, b;
  for (int i = 0; i < 2; ++i) {
    for (auto [studio, frame] : {std::pair(&*wet, &a), std::pair(&*dry, &b)}) {
      frame->captured = Capture(0.3 + i / 30.0);
      studio->Run(*frame, times_);
    }
  }
  EXPECT_GT(cv::countNonZero(cv::abs(a.composite.y - b.composite.y) > 4), 300);
}

// piVE 5, in the room that he comes from.
class AvatarTest : public StudioTest {
 protected:
  static Studio MakeAvatar(std::optional<Avatar> avatar) {
    StudioSetup setup;
    setup.rig = SyntheticRig();
    setup.rig.vignetting_a = setup.rig.vignetting_b = 0;
    setup.scanned = ScannedRoom{.model = Scan(), .doubt = {.registration_px = 0.3f, .depth_sigma_m = 0.003f}};
    setup.scene.emplace().avatar = std::move(avatar);
    auto studio = Studio::Create(std::move(setup));
    EXPECT_TRUE(studio) << studio.error().message;
    return std::move(*studio);
  }
  // After the frame before it, which depth's motion is seen from.
  static void Show(Studio& studio, double t_s, Frame* frame) {
    for (const double before_s : {1 / 30.0, 0.0}) {
      frame->captured = Capture(t_s - before_s);
      studio.Run(*frame, times_);
    }
  }
};

TEST_F(AvatarTest, WhoIsPutWhereHeStandsIsSeenAsHeIs) {
  Studio plain = MakeAvatar(std::nullopt), avatar = MakeAvatar(Avatar{});
  Frame a, b;
  Show(plain, 8.5, &a);
  Show(avatar, 8.5, &b);
  EXPECT_EQ(b.T_world_view.matrix(), a.T_world_color.matrix());
  const cv::Mat his = a.alpha == 255, off = cv::abs(a.composite.y - b.composite.y) > 3;
  ASSERT_GT(cv::countNonZero(his), 5000);
  EXPECT_LT(cv::countNonZero(his & off), cv::countNonZero(his) / 200);
  EXPECT_LT(cv::countNonZero(cv::abs(a.alpha - b.alpha) > 3), cv::countNonZero(his) / 50);
  // Away from him the picture is the camera's own.
  cv::Mat around;
  cv::dilate((a.alpha > 0) | (a.label == kLabelShadow), around, cv::Mat::ones(61, 61, CV_8U));
  EXPECT_EQ(cv::countNonZero((around == 0) & (b.composite.y != b.captured->color.y)), 0);
  int near = 0, known = 0;
  for (int i = 0; i < a.depth_mm.rows * a.depth_mm.cols; ++i) {
    if (a.depth_mm(i) == 0 || b.depth_mm(i) == 0) continue;
    ++known;
    near += std::abs(a.depth_mm(i) - b.depth_mm(i)) < 30 ? 1 : 0;
  }
  EXPECT_GT(near, known * 99 / 100);
}

TEST_F(AvatarTest, HeLeavesHisPlaceAndStandsSmallerFartherAway) {
  const RigidTransform& T_world_color = synthetic_->TruthPose();
  Avatar away;
  away.position = {0.7 * T_world_color.linear()(0, 2), 0.7 * T_world_color.linear()(1, 2), 0};
  Studio plain = MakeAvatar(std::nullopt), avatar = MakeAvatar(away);
  Frame a, b;
  Show(plain, 8.5, &a);
  Show(avatar, 8.5, &b);
  const cv::Rect was = cv::boundingRect(a.alpha >= 128), is = cv::boundingRect(b.alpha >= 128);
  const double z = cv::mean(a.actor_depth_m, a.actor_depth_m > 0)[0];
  EXPECT_NEAR(static_cast<double>(is.height) / was.height, z / (z + 0.7), 0.04);
  // Where only he was the room is seen again.
  const cv::Mat left = (a.alpha == 255) & (b.alpha == 0);
  YuvImage empty;
  synthetic_->RenderColor(0.3, empty);
  ASSERT_GT(cv::countNonZero(left), 1000);
  EXPECT_LT(cv::mean(cv::abs(b.composite.y - empty.y), left)[0], 6);
}

TEST_F(AvatarTest, AnotherCameraSeesHimAndTheRoomFromItsOwnPlace) {
  const RigidTransform T = synthetic_->TruthPose();
  const Eigen::Vector3d forward = T.linear().col(2), right = T.linear().col(0);
  Avatar elsewhere;
  elsewhere.camera =
      AvatarCamera{T.translation() + 0.3 * right + 0.3 * forward, T.translation() + 4 * forward, 45};
  Studio avatar = MakeAvatar(elsewhere);
  Frame f;
  Show(avatar, 8.5, &f);
  const auto pose = TTargetView(*elsewhere.camera);
  ASSERT_TRUE(pose);
  EXPECT_TRUE(f.T_world_view.isApprox(*pose));
  EXPECT_NEAR(avatar.view().fx, 0.5 * avatar.view().width / std::tan(22.5 * 3.14159265 / 180), 0.1);
  ASSERT_GT(cv::countNonZero(f.alpha == 255), 5000);
  // The middle of what is seen of him, taken to the world, is the middle of where he is.
  const auto middle = [](const cv::Mat1b& alpha, const cv::Mat1f& z, const PinholeCamera& camera,
                         const RigidTransform& T_world_camera) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    int count = 0;
    for (int y = 0; y < alpha.rows; y += 4) {
      for (int x = 0; x < alpha.cols; x += 4) {
        const double depth = z(y / 2, x / 2);
        if (alpha(y, x) < 255 || !(depth > 0)) continue;
        sum += T_world_camera * (depth * camera.Unproject(Eigen::Vector2d(x, y))->homogeneous());
        ++count;
      }
    }
    return Eigen::Vector3d(sum / count);
  };
  Studio plain = MakeAvatar(std::nullopt);
  Frame own;
  Show(plain, 8.5, &own);
  const Eigen::Vector3d a = middle(own.alpha, own.actor_depth_m, plain.view(), own.T_world_color),
                        b = middle(f.alpha, f.actor_depth_m, avatar.view(), f.T_world_view);
  EXPECT_LT((a - b).norm(), 0.05);
}

TEST_F(AvatarTest, AnEditMovesHim) {
  Studio studio = MakeAvatar(Avatar{});
  Frame f;
  Show(studio, 8.5, &f);
  const cv::Rect was = cv::boundingRect(f.alpha >= 128);
  Scene moved = *studio.scene();
  ++moved.revision;
  moved.avatar->position = 0.5 * synthetic_->TruthPose().linear().col(0);
  studio.SetScene(std::make_shared<const Scene>(moved));
  Show(studio, 8.5, &f);
  EXPECT_GT(cv::boundingRect(f.alpha >= 128).x, was.x + 40);
}

TEST(Studio, AnAvatarNeedsARoomToStandIn) {
  StudioSetup setup;
  setup.rig = AssumedRig(64, 48, 0.001);
  setup.scene.emplace().avatar = Avatar{};
  const auto studio = Studio::Create(std::move(setup));
  ASSERT_FALSE(studio);
  EXPECT_EQ(studio.error().code, ErrorCode::kInvalidConfig);
  EXPECT_NE(studio.error().message.find("--environment"), std::string::npos);
}

TEST(Studio, AScannedRoomNeedsAPose) {
  StudioSetup setup;
  setup.rig = AssumedRig(64, 48, 0.001);
  RoomModel room;
  room.positions = {{0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
  room.uvs.resize(3, Eigen::Vector2f::Zero());
  room.indices = {0, 1, 2};
  room.texture_bgr = cv::Mat3b(2, 2);
  setup.scanned = ScannedRoom{.model = room};
  const auto studio = Studio::Create(std::move(setup));
  ASSERT_FALSE(studio);
  EXPECT_EQ(studio.error().code, ErrorCode::kInvalidConfig);
  EXPECT_NE(studio.error().message.find("--poses"), std::string::npos);
}

TEST(Studio, AWorldSceneNeedsAPose) {
  StudioSetup setup;
  setup.rig = AssumedRig(64, 48, 0.001);
  setup.scene = Scene{};
  const auto studio = Studio::Create(std::move(setup));
  ASSERT_FALSE(studio);
  EXPECT_EQ(studio.error().code, ErrorCode::kInvalidConfig);
  EXPECT_NE(studio.error().message.find("frame: camera"), std::string::npos);
}

TEST(FrameStages, TheTableNamesEveryStageOnce) {
  std::set<std::string_view> names;
  for (const StageInfo& stage : AllStages()) {
    EXPECT_TRUE(names.insert(stage.name).second) << stage.name;
    EXPECT_GT(stage.budget_ms, 0);
  }
}

}  // namespace
}  // namespace mixstage
