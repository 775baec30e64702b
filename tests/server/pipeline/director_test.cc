// SPDX-License-Identifier: Apache-2.0
//
// The scene of a show, edited over real sockets.
#include "server/pipeline/director.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "proto/synthetic/rig.h"
#include "server/render/illumination.h"
#include "server/scene/scene_file.h"
#include "tests/server/delivery/test_viewer.h"
#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using testing::HasSubstr;

constexpr const char* kTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

struct Show {
  explicit Show(
      decltype(Director::Setup::load) load = [](const auto& file, const auto&) { return LoadModel(file); },
      GatewayConfig config = {.listen = "127.0.0.1:0"}) {
    folder.Write("a.obj", kTriangle);
    config.edits = edits;
    gateway.emplace(config);
    EXPECT_TRUE(gateway->Start());
    Scene scene;
    SceneObject object;
    object.id = 1;
    object.name = "a";
    object.file = "a.obj";
    object.mesh = std::make_shared<const Mesh>(LoadModel(folder.path() / "a.obj")->mesh);
    object.placing = Placing{};
    object.T_scene_object = TSceneObject(*object.placing, object.usual_up);
    scene.objects.push_back(object);
    UsualLight usual = UsualLightOf(scene.frame);
    usual.key.id = 1;
    director.emplace(Director::Setup{.scene = scene,
                                     .default_light = {{usual.key}, usual.ambient},
                                     .file = folder.path() / "scene.yaml",
                                     .color = SyntheticRig().color,
                                     .edits = edits,
                                     .load = std::move(load)},
                     *gateway);
  }
  // A room with a surface everywhere, 3 m in front of a camera at the origin that looks down.
  void SeeFloor() {
    BackgroundModel room;
    room.room_depth_m = cv::Mat1f(192, 256, 3.0f);
    room.sigma_m = cv::Mat1f(192, 256, 0.01f);
    RigidTransform T = RigidTransform::Identity();
    T.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()).toRotationMatrix();
    T.translation().z() = 3;
    director->SeeRoom(std::make_shared<const BackgroundModel>(room), T);
  }

  test::TemporaryFolder folder;
  std::shared_ptr<EditQueue> edits = std::make_shared<EditQueue>(kMaxWaitingEdits, WhenFull::kDropOldest);
  std::optional<Gateway> gateway;
  std::optional<Director> director;
};

void Send(TestViewer& viewer, int id, EditOp op, bool live = false) {
  EXPECT_TRUE(viewer.SendText(ToJson(WatchEdit{id, live, std::move(op)})));
}

std::optional<WatchScene> SceneWhere(TestViewer& viewer,
                                     const std::function<bool(const WatchScene&)>& wanted) {
  std::optional<WatchScene> found;
  viewer.ReadUntil([&](const Received& received) {
    const auto message = ParseServerMessage(received.bytes);
    const auto* scene = message ? std::get_if<WatchScene>(&*message) : nullptr;
    if (scene != nullptr && wanted(*scene)) found = *scene;
    return found.has_value();
  });
  return found;
}

std::string RefusalOf(TestViewer& viewer, int id) {
  std::string reason;
  viewer.ReadUntil([&](const Received& received) {
    const auto message = ParseServerMessage(received.bytes);
    const auto* refused = message ? std::get_if<WatchRefused>(&*message) : nullptr;
    if (refused != nullptr && refused->id == id) reason = refused->reason;
    return !reason.empty();
  });
  return reason;
}

TEST(Director, WhoComesGetsTheSceneAndEveryoneItsChanges) {
  Show show;
  TestViewer a(show.gateway->port());
  ASSERT_TRUE(
      SceneWhere(a, [](const WatchScene& s) { return s.objects.size() == 1 && s.models.size() == 1; }));
  Send(a, 1, MoveObject{1, ToPosition{{1, 2, 3}}});
  TestViewer b(show.gateway->port());
  for (TestViewer* viewer : {&a, &b}) {
    EXPECT_TRUE(
        SceneWhere(*viewer, [](const WatchScene& s) { return s.objects.at(0).base[1] == 2 && s.unsaved; }));
  }
  std::shared_ptr<const Scene> scene;
  ASSERT_TRUE(Eventually([&] { return (scene = show.director->TakeScene()) != nullptr; }));
  EXPECT_EQ(show.director->TakeScene(), nullptr) << "taken once";
}

TEST(Director, ARefusalGoesToItsSender) {
  Show show;
  TestViewer a(show.gateway->port()), b(show.gateway->port());
  Send(a, 7, DeleteObject{9});
  EXPECT_THAT(RefusalOf(a, 7), HasSubstr("no object 9"));
  Send(a, 8, DeleteObject{1});
  EXPECT_TRUE(b.ReadUntil([](const Received& r) {
    EXPECT_THAT(r.bytes, Not(HasSubstr("refused")));
    return r.text && r.bytes.find(R"("objects":[])") != std::string::npos;
  }));
}

TEST(Director, AModelIsAddedWhereTheRoomHasASurface) {
  Show show;
  TestViewer a(show.gateway->port());
  Send(a, 1, AddObject{"a.obj", {512, 384}});
  EXPECT_THAT(RefusalOf(a, 1), HasSubstr("depth is not known"));
  show.SeeFloor();
  Send(a, 2, AddObject{"a.obj", {512, 384}});
  const auto scene = SceneWhere(a, [](const WatchScene& s) { return s.objects.size() == 2; });
  ASSERT_TRUE(scene);
  EXPECT_NEAR(scene->objects[1].base[2], 0, 1e-3);
  Send(a, 3, AddObject{"../a.obj", {512, 384}});
  EXPECT_THAT(RefusalOf(a, 3), HasSubstr("none of the models"));
}

TEST(Director, AThingIsAdoptedWhenTheFramesHaveSeenIt) {
  Show show;
  TestViewer a(show.gateway->port());
  EXPECT_FALSE(show.director->TakeLook());
  Send(a, 1, AdoptThing{{100, 200}});
  std::optional<PicturePoint> look;
  ASSERT_TRUE(Eventually([&] { return (look = show.director->TakeLook()).has_value(); }));
  EXPECT_EQ(*look, (PicturePoint{100, 200}));
  Send(a, 2, AdoptThing{{1, 2}});
  EXPECT_THAT(RefusalOf(a, 2), HasSubstr("Another thing"));
  show.director->SeeThing(Fail(ErrorCode::kBadInput, "It moves."));
  EXPECT_EQ(RefusalOf(a, 1), "It moves.");

  Send(a, 3, AdoptThing{{100, 200}});
  ASSERT_TRUE(Eventually([&] { return show.director->TakeLook().has_value(); }));
  show.director->SeeThing(std::make_shared<const AdoptedThing>());
  const auto adopted = SceneWhere(a, [](const WatchScene& s) { return s.adopted == 1; });
  ASSERT_TRUE(adopted);
  EXPECT_TRUE(adopted->can_undo && !adopted->unsaved);
  std::shared_ptr<const Scene> scene;
  ASSERT_TRUE(Eventually([&] { return (scene = show.director->TakeScene()) != nullptr; }));
  EXPECT_EQ(scene->adopted.size(), 1);
  Send(a, 4, UndoEdit{});
  ASSERT_TRUE(SceneWhere(a, [](const WatchScene& s) { return s.adopted == 0 && s.can_redo; }));
  Send(a, 5, RedoEdit{});
  ASSERT_TRUE(SceneWhere(a, [](const WatchScene& s) { return s.adopted == 1; }));
  Send(a, 6, ForgetThings{});
  ASSERT_TRUE(SceneWhere(a, [](const WatchScene& s) { return s.adopted == 0; }));
  Send(a, 7, ForgetThings{});
  EXPECT_THAT(RefusalOf(a, 7), HasSubstr("Nothing was adopted"));
}

TEST(Director, AFileThatHasJustBeenPutThereCanBeAdded) {
  Show show;
  show.SeeFloor();
  TestViewer a(show.gateway->port());
  show.folder.Write("b.obj", kTriangle);
  show.folder.Write("notes.txt", "no model");
  Send(a, 1, AddObject{"b.obj", {512, 384}});
  const auto scene = SceneWhere(a, [](const WatchScene& s) { return s.objects.size() == 2; });
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->models, (std::vector<std::string>{"a.obj", "b.obj"}));
}

TEST(Director, WhileAModelIsReadOthersGoOnEditing) {
  std::atomic<bool> go = false;
  Show show([&](const std::filesystem::path& file, const std::stop_token& stop) -> Result<LoadedModel> {
    while (!go && !stop.stop_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return Fail(ErrorCode::kBadInput, file.string() + ": crashed the importer (signal 11)");
  });
  show.SeeFloor();
  show.folder.Write("b.obj", "bad");
  TestViewer a(show.gateway->port());
  Send(a, 1, AddObject{"b.obj", {512, 384}});
  Send(a, 2, HideObject{1, true});
  EXPECT_TRUE(SceneWhere(a, [](const WatchScene& s) { return s.objects.at(0).hidden; }));
  go = true;
  EXPECT_EQ(RefusalOf(a, 1), "b.obj: crashed the importer (signal 11)") << "no word of the server's folders";
  go = false;
  Send(a, 3, AddObject{"b.obj", {512, 384}});
  Send(a, 4, HideObject{1, false});
  EXPECT_TRUE(SceneWhere(a, [](const WatchScene& s) { return !s.objects.at(0).hidden; }));
  show.director.reset();  // does not wait for the model
}

TEST(Director, ADragOfAThousandEditsIsOneStepAndClosesNobody) {
  Show show({}, {.listen = "127.0.0.1:0", .edits_per_s = 10'000, .edit_burst = 10'000});
  TestViewer a(show.gateway->port());
  for (int i = 0; i < 1000; ++i) {
    Send(a, i, MoveObject{1, ToPosition{{0.01 * i, 0, 0}}}, true);
    if (i % 100 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(60));
  }
  Send(a, 1000, MoveObject{1, ToPosition{{20, 0, 0}}});
  ASSERT_TRUE(SceneWhere(a, [](const WatchScene& s) { return s.objects.at(0).base[0] == 20; }));
  Send(a, 1001, UndoEdit{});
  const auto back = SceneWhere(a, [](const WatchScene& s) { return s.objects.at(0).base[0] == 0.5; });
  ASSERT_TRUE(back) << "the triangle's middle, where the drag began";
  EXPECT_FALSE(back->can_undo);
}

TEST(Director, SaveWritesAFileThatReadsBack) {
  Show show;
  TestViewer a(show.gateway->port());
  Send(a, 1, MoveObject{1, ToPosition{{1, 2, 3}}});
  ASSERT_TRUE(SceneWhere(a, [](const WatchScene& s) { return s.unsaved; }));
  Send(a, 2, SaveScene{});
  ASSERT_TRUE(SceneWhere(a, [](const WatchScene& s) { return !s.unsaved; }));
  const auto scene = LoadScene(show.folder.path() / "scene.yaml", LoadModel);
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(scene->scene.objects.at(0).placing->position[1], 2);
}

TEST(GatewayEdits, WithoutASceneAnEditIsRefused) {
  Gateway gateway({.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  Send(viewer, 5, UndoEdit{});
  EXPECT_THAT(RefusalOf(viewer, 5), HasSubstr("--scene"));
}

TEST(GatewayEdits, AFloodOfEditsIsClosed) {
  const auto edits = std::make_shared<EditQueue>(kMaxWaitingEdits, WhenFull::kDropOldest);
  Gateway gateway({.listen = "127.0.0.1:0", .edits_per_s = 1, .edit_burst = 50, .edits = edits});
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  for (int i = 0; i < 60; ++i) {
    if (!viewer.SendText(ToJson(WatchEdit{i, false, UndoEdit{}}))) break;
  }
  EXPECT_EQ(viewer.ReadCloseCode(), 1008);
  EXPECT_EQ(gateway.counters().closed_rate, 1u);
  EXPECT_EQ(edits->size(), 50u);
}

TEST(GatewayEdits, WhatNobodyTakesIsRefusedWhenThereAreTooMany) {
  const auto edits = std::make_shared<EditQueue>(kMaxWaitingEdits, WhenFull::kDropOldest);
  Gateway gateway({.listen = "127.0.0.1:0", .edits_per_s = 1000, .edit_burst = 1000, .edits = edits});
  ASSERT_TRUE(gateway.Start());
  TestViewer viewer(gateway.port());
  for (int i = 0; i <= static_cast<int>(kMaxWaitingEdits); ++i) Send(viewer, i, UndoEdit{});
  EXPECT_THAT(RefusalOf(viewer, kMaxWaitingEdits), HasSubstr("Too many"));
  EXPECT_EQ(edits->size(), kMaxWaitingEdits);
}

TEST(GatewayEdits, ASlowViewerGetsTheNewestScene) {
  WatchObject object{.id = 1, .name = std::string(400, 'n')};
  WatchScene scene;
  scene.objects.assign(200, object);
  std::vector<std::string> texts;  // written before the viewer comes: he is closed when he stalls for long
  for (scene.revision = 1; scene.revision <= 500; ++scene.revision) texts.push_back(ToJson(scene));
  Gateway gateway({.listen = "127.0.0.1:0", .send_buffer_bytes = 1 << 12});
  ASSERT_TRUE(gateway.Start());
  TestViewer slow(gateway.port(), {.receive_buffer_bytes = 4096});
  ASSERT_TRUE(Eventually([&] { return gateway.counters().viewers == 1; }));
  for (const std::string& text : texts) {
    gateway.PublishScene(text);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  int scenes = 0;
  EXPECT_TRUE(SceneWhere(slow, [&](const WatchScene& s) { return ++scenes, s.revision == 500; }));
  EXPECT_LT(scenes, 500);
}

}  // namespace
}  // namespace mixstage
