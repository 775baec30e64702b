// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_editor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "server/scene/scene_write.h"
#include "tests/server/scene/test_motion.h"

namespace mixstage {
namespace {

using testing::HasSubstr;

// A floor at height 0 and a table top at 0.75 for x in 1..2; pixels (u, v) look straight down at x = u / 100,
// y = v / 100 from a height of 3 m. Along z in world scenes, along -y in camera scenes.
class FlatRoom : public RoomProbe {
 public:
  explicit FlatRoom(SceneFrame frame = SceneFrame::kWorld) : frame_(frame) {}
  std::optional<Ray> RayThrough(double u, double v) const override {
    if (u < 0) return std::nullopt;
    return Ray{Point(u / 100, v / 100, 3), -UpOf(frame_)};
  }
  std::optional<Eigen::Vector3d> SurfaceUnder(double u, double v) const override {
    if (u < 0 || u > 1000) return std::nullopt;
    return Point(u / 100, v / 100, u >= 100 && u <= 200 ? 0.75 : 0);
  }
  std::optional<double> HighestSurfaceBelow(const Eigen::Vector3d& base, double) const override {
    if (base.x() > 10) return std::nullopt;
    return base.x() >= 1 && base.x() <= 2 && UpOf(frame_).dot(base) >= 0.75 ? 0.75 : 0;
  }

 private:
  [[nodiscard]] Eigen::Vector3d Point(double x, double y, double height) const {
    return frame_ == SceneFrame::kWorld ? Eigen::Vector3d(x, y, height) : Eigen::Vector3d(x, -height, y);
  }
  SceneFrame frame_;
};

// A box of 0.2 x 1 x 0.4 m whose file coordinates have y up and start at (1, 2, 3).
std::shared_ptr<const Mesh> Box() {
  auto mesh = std::make_shared<Mesh>();
  for (int i = 0; i < 8; ++i) {
    mesh->positions.emplace_back(1 + 0.2f * static_cast<float>(i & 1), 2 + static_cast<float>(i >> 1 & 1),
                                 3 + 0.4f * static_cast<float>(i >> 2));
  }
  mesh->normals.assign(8, Eigen::Vector3f::UnitY());
  mesh->indices = {0, 1, 2, 1, 2, 3, 4, 5, 6};
  mesh->materials.resize(1);
  mesh->parts = {{0, 9, 0}};
  return mesh;
}

const DefaultLight kDefault = {
    .lights = {{.id = 1, .name = "key", .shape = DirectionalLight{}, .intensity = 0.5f}},
    .ambient = Ambient{0.4f, 0.2f}};
const EditSource kAnna{1, "anna"}, kBen{2, "ben"};

Scene SceneOf(SceneFrame frame, std::uint32_t objects) {
  Scene scene;
  scene.frame = frame;
  if (frame == SceneFrame::kWorld) scene.avatar = Avatar{};
  const std::shared_ptr<const Mesh> box = Box();
  for (std::uint32_t id = 1; id <= objects; ++id) {
    SceneObject object;
    object.id = id;
    object.name = "box " + std::to_string(id);
    object.file = "box.glb";
    object.mesh = box;
    object.placing = Placing{};
    if (frame == SceneFrame::kCamera) object.placing->rotation_deg[0] = 90;
    object.T_scene_object = TSceneObject(*object.placing, UpAxis::kY);
    scene.objects.push_back(object);
  }
  return scene;
}

struct Stage {
  explicit Stage(SceneFrame frame = SceneFrame::kWorld, std::uint32_t objects = 2)
      : room(frame), editor(SceneOf(frame, objects), kDefault) {}
  Status Do(EditOp op, bool live = false, const EditSource& source = kAnna) {
    return editor.Apply({.id = 1, .live = live, .op = std::move(op)}, source, room, &model);
  }
  // The scene as it would be saved: everything of it but its revision.
  [[nodiscard]] std::string Content() const { return ToYaml(*editor.scene()); }
  [[nodiscard]] Eigen::Vector3d Base(std::size_t i) {
    const auto base = editor.Message().objects.at(i).base;
    return {base[0], base[1], base[2]};
  }
  FlatRoom room;
  SceneEditor editor;
  AddedModel model{Box(), UpAxis::kY};
};

MoveObject To(std::uint32_t object, double x, double y, double z) { return {object, ToPosition{{x, y, z}}}; }

std::vector<EditOp> EveryChange() {
  return {AddObject{"vase.glb", {150, 50}},
          To(1, 0.1, 0.2, 0.3),
          MoveObject{1, ToSurface{{120, 80}}},
          MoveObject{2, AlongFloor{{10, 20}}},
          TurnObject{2, 33.3},
          DropObject{1},
          HideObject{1, true},
          DeleteObject{2},
          ChangeLight{1, {{0.0, 0.6, 0.8}}, {{1, 0.5, 0.25}}, 0.75},
          PlaceAvatar{{{1, 2, 0}}, 30}};
}

TEST(SceneEditor, UndoOfAnEditIsTheSceneBeforeAndRedoTheSceneAfter) {
  Stage stage;
  std::vector<std::string> contents = {stage.Content()};
  for (const EditOp& op : EveryChange()) {
    const auto done = stage.Do(op);
    ASSERT_TRUE(done) << OpName(op) << ": " << done.error().message;
    contents.push_back(stage.Content());
  }
  for (std::size_t i = contents.size() - 1; i-- > 0;) {
    ASSERT_TRUE(stage.Do(UndoEdit{}));
    EXPECT_EQ(stage.Content(), contents[i]) << i;
  }
  EXPECT_FALSE(stage.Do(UndoEdit{}));
  for (std::size_t i = 1; i < contents.size(); ++i) {
    ASSERT_TRUE(stage.Do(RedoEdit{}));
    EXPECT_EQ(stage.Content(), contents[i]) << i;
  }
  EXPECT_FALSE(stage.Do(RedoEdit{}));
}

TEST(SceneEditor, EveryChangeRaisesTheRevisionAndARefusalChangesNothing) {
  Stage stage;
  std::uint64_t revision = stage.editor.scene()->revision;
  for (const EditOp& op : EveryChange()) {
    ASSERT_TRUE(stage.Do(op));
    EXPECT_GT(stage.editor.scene()->revision, revision);
    revision = stage.editor.scene()->revision;
  }
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_GT(stage.editor.scene()->revision, revision);
  const auto before = stage.editor.scene();
  EXPECT_FALSE(stage.Do(To(1, 1e3, 0, 0)));
  EXPECT_EQ(stage.editor.scene(), before);
}

TEST(SceneEditor, ObjectsStandWhereTheyArePut) {
  for (const SceneFrame frame : {SceneFrame::kWorld, SceneFrame::kCamera}) {
    Stage stage(frame);
    const auto at = [&](double x, double y, double height) {
      return frame == SceneFrame::kWorld ? Eigen::Vector3d(x, y, height) : Eigen::Vector3d(x, -height, y);
    };
    ASSERT_TRUE(stage.Do(MoveObject{1, ToSurface{{150, 40}}}));
    EXPECT_LT((stage.Base(0) - at(1.5, 0.4, 0.75)).norm(), 1e-9);
    ASSERT_TRUE(stage.Do(MoveObject{1, AlongFloor{{300, 40}}}));
    EXPECT_LT((stage.Base(0) - at(3, 0.4, 0.75)).norm(), 1e-9) << "a drag keeps the height";
    ASSERT_TRUE(stage.Do(DropObject{1}));
    EXPECT_TRUE(stage.editor.scene()->objects[0].drop);
    EXPECT_LT((stage.Base(0) - at(3, 0.4, 0.75)).norm(), 1e-9) << "it is physics that lets it fall";
    ASSERT_TRUE(stage.Do(AddObject{"vase.glb", {200, 0}}));
    EXPECT_LT((stage.Base(2) - at(2, 0, 0.75)).norm(), 1e-9);
    EXPECT_NEAR(stage.editor.Message().objects[2].radius_m, std::hypot(0.1, 0.2), 1e-6);
    const Eigen::Vector3d top =
        stage.editor.scene()->objects[2].T_scene_object * Eigen::Vector3d(1.1, 3, 3.2);
    EXPECT_LT((top - at(2, 0, 1.75)).norm(), 1e-6) << "upright";
  }
}

TEST(SceneEditor, ATurnIsAboutUpThroughTheBaseAndAFullTurnIsNone) {
  for (const SceneFrame frame : {SceneFrame::kWorld, SceneFrame::kCamera}) {
    Stage stage(frame);
    ASSERT_TRUE(stage.Do(MoveObject{1, ToSurface{{150, 40}}}));
    const Eigen::Affine3d before = stage.editor.scene()->objects[0].T_scene_object;
    const Eigen::Vector3d base = stage.Base(0);
    ASSERT_TRUE(stage.Do(TurnObject{1, 90}));
    const Eigen::Affine3d turned = stage.editor.scene()->objects[0].T_scene_object;
    const Eigen::Matrix3d R = turned.linear() * before.linear().inverse();
    EXPECT_LT((R - Eigen::AngleAxisd(std::numbers::pi / 2, UpOf(frame)).matrix()).norm(), 1e-9);
    EXPECT_LT((stage.Base(0) - base).norm(), 1e-9);
    EXPECT_TRUE(stage.editor.scene()->objects[0].placing) << "a turn about up stays a placing";
    for (int i = 0; i < 7; ++i) ASSERT_TRUE(stage.Do(TurnObject{1, 45}));
    ASSERT_TRUE(stage.Do(TurnObject{1, -45}));
    EXPECT_LT((stage.editor.scene()->objects[0].T_scene_object.matrix() - before.matrix()).norm(), 1e-9);
  }
}

TEST(SceneEditor, APoseThatNoPlacingDescribesTurnsAllTheSame) {
  Scene scene = SceneOf(SceneFrame::kWorld, 1);
  scene.objects[0].placing.reset();
  scene.objects[0].T_scene_object = Eigen::Translation3d(1, 2, 3) *
                                    Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 2) / 3) *
                                    Eigen::Scaling(Eigen::Vector3d(1, -2, 0.5));
  SceneEditor editor(scene, kDefault);
  ASSERT_TRUE(editor.Apply({.op = TurnObject{1, 30}}, kAnna, FlatRoom()));
  const Eigen::Matrix3d R =
      editor.scene()->objects[0].T_scene_object.linear() * scene.objects[0].T_scene_object.linear().inverse();
  EXPECT_LT((R - Eigen::AngleAxisd(std::numbers::pi / 6, Eigen::Vector3d::UnitZ()).matrix()).norm(), 1e-12);
}

TEST(SceneEditor, ADragIsOneStep) {
  Stage stage;
  const std::string before = stage.Content();
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(stage.Do(To(1, 0.1 * i, 0, 0), /*live=*/true));
  EXPECT_TRUE(stage.editor.Message().can_undo) << "also in the middle of it";
  ASSERT_TRUE(stage.Do(To(1, 5, 0, 0)));
  const std::string after = stage.Content();
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_EQ(stage.Content(), before);
  EXPECT_FALSE(stage.editor.Message().can_undo);
  ASSERT_TRUE(stage.Do(RedoEdit{}));
  EXPECT_EQ(stage.Content(), after);
}

TEST(SceneEditor, ADragThatWasNeverEndedIsAStepToo) {
  Stage stage;
  const std::string before = stage.Content();
  ASSERT_TRUE(stage.Do(To(1, 3, 0, 0), true));
  const std::string dragged = stage.Content();
  ASSERT_TRUE(stage.Do(HideObject{2, true}, false, kBen));
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_EQ(stage.Content(), dragged);
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_EQ(stage.Content(), before);
}

TEST(SceneEditor, ADragThatEndsOutsideStaysWhereItWasLast) {
  Stage stage;
  ASSERT_TRUE(stage.Do(To(1, 3, 0, 0), true));
  EXPECT_FALSE(stage.Do(To(1, 3000, 0, 0)));
  EXPECT_EQ(stage.Base(0).x(), 3);
  ASSERT_TRUE(stage.Do(To(2, 1, 0, 0)));
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_EQ(stage.Base(0).x(), 3) << "the drag was its own step";
}

TEST(SceneEditor, TheLastWriterWins) {
  Stage stage;
  ASSERT_TRUE(stage.Do(To(1, 1, 0, 0), false, kAnna));
  ASSERT_TRUE(stage.Do(To(1, 2, 0, 0), false, kBen));
  EXPECT_EQ(stage.Base(0).x(), 2);
  EXPECT_EQ(stage.editor.Message().by, "ben");
  ASSERT_TRUE(stage.Do(UndoEdit{}, false, kAnna)) << "the history is everybody's";
  EXPECT_EQ(stage.Base(0).x(), 1);
}

TEST(SceneEditor, IdsAreNeverUsedAgain) {
  Stage stage;
  ASSERT_TRUE(stage.Do(AddObject{"vase.glb", {0, 0}}));
  EXPECT_EQ(stage.editor.scene()->objects.back().id, 3u);
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  ASSERT_TRUE(stage.Do(AddObject{"vase.glb", {0, 0}}));
  EXPECT_EQ(stage.editor.scene()->objects.back().id, 4u);
  ASSERT_TRUE(stage.Do(DeleteObject{4}));
  EXPECT_FALSE(stage.Do(To(4, 0, 0, 0)));
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_TRUE(stage.Do(To(4, 0, 0, 0))) << "the same object came back";
}

TEST(SceneEditor, NamesOfAddedObjectsAreFree) {
  Stage stage;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(stage.Do(AddObject{"box 1.glb", {0, 0}}));
  const auto& objects = stage.editor.scene()->objects;
  EXPECT_EQ(objects[2].name, "box 1 2");
  EXPECT_EQ(objects[4].name, "box 1 4");
}

TEST(SceneEditor, AModelInCentimetresIsBroughtToAStagesSize) {
  Stage stage;
  auto large = std::make_shared<Mesh>(*Box());
  for (Eigen::Vector3f& p : large->positions) p *= 180;
  stage.model.mesh = large;
  ASSERT_TRUE(stage.Do(AddObject{"fox.glb", {0, 0}}));
  EXPECT_NEAR(stage.editor.scene()->objects.back().placing->scale, 0.01, 1e-12);
}

TEST(SceneEditor, RefusalsSayWhy) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  Stage stage;
  const std::vector<std::pair<EditOp, const char*>> refused = {
      {To(1, kNan, 0, 0), "100 m"},
      {To(1, 0, 0, 101), "100 m"},
      {To(9, 0, 0, 0), "no object 9"},
      {MoveObject{1, ToSurface{{-5, 0}}}, "depth is not known"},
      {MoveObject{1, AlongFloor{{-5, 0}}}, "no point at the height"},
      {TurnObject{1, kNan}, "36000"},
      {TurnObject{9, 1}, "no object 9"},
      {DropObject{9}, "no object"},
      {DeleteObject{9}, "no object"},
      {HideObject{9, true}, "no object"},
      {AddObject{"vase.glb", {2000, 0}}, "depth is not known"},
      {ChangeLight{7, {}, {}, 1.0}, "no light 7"},
      {ChangeLight{1, {}, {}, -1.0}, "0 to 1000"},
      {ChangeLight{1, {}, {}, kNan}, "0 to 1000"},
      {ChangeLight{1, {}, {{0, 0, 1.5}}, {}}, "0 to 1"},
      {ChangeLight{1, {{0, 0, 0}}, {}, {}}, "length 0"},
      {ChangeLight{1, {{kNan, 0, 0}}, {}, {}}, "100 m"},
      {UndoEdit{}, "nothing to undo"},
      {RedoEdit{}, "nothing to redo"},
  };
  for (const auto& [op, why] : refused) {
    const auto done = stage.Do(op);
    ASSERT_FALSE(done) << OpName(op) << " " << why;
    EXPECT_THAT(done.error().message, HasSubstr(why));
  }
  EXPECT_FALSE(stage.editor.Message().can_undo);
}

TEST(SceneEditor, AnAvatarIsPlacedAndTurned) {
  Stage stage;
  ASSERT_TRUE(stage.Do(PlaceAvatar{{{1, 2, 0.1}}, {}}, /*live=*/true));
  ASSERT_TRUE(stage.Do(PlaceAvatar{{}, 390}));
  EXPECT_EQ(stage.editor.scene()->avatar->position, Eigen::Vector3d(1, 2, 0.1));
  ASSERT_TRUE(stage.editor.Message().avatar);
  EXPECT_EQ(stage.editor.Message().avatar->turn_deg, 30);
  EXPECT_FALSE(stage.Do(PlaceAvatar{{{1000, 0, 0}}, {}}));
  EXPECT_FALSE(stage.Do(PlaceAvatar{{}, 1e9}));
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_EQ(stage.editor.scene()->avatar, Avatar{});
  Stage without(SceneFrame::kCamera);
  EXPECT_FALSE(without.Do(PlaceAvatar{{}, 10}));
}

TEST(SceneEditor, AnObjectIsGivenAnotherAnimation) {
  Scene scene = SceneOf(SceneFrame::kWorld, 2);
  scene.objects[0].mesh = test::Moving(*Box());
  SceneEditor editor(scene, kDefault);
  const FlatRoom room;
  const auto animate = [&](std::uint32_t object, const std::string& name) {
    return editor.Apply({.id = 1, .op = AnimateObject{object, name}}, kAnna, room, nullptr);
  };
  EXPECT_EQ(editor.Message().objects[0].animations, (std::vector<std::string>{"go", "rise"}));
  EXPECT_EQ(editor.Message().objects[0].animation, "go");
  EXPECT_TRUE(editor.Message().objects[1].animations.empty());
  ASSERT_TRUE(animate(1, "rise"));
  EXPECT_EQ(editor.Message().objects[0].animation, "rise");
  ASSERT_TRUE(animate(1, "none"));
  EXPECT_EQ(editor.scene()->objects[0].clip, -1);
  EXPECT_FALSE(animate(1, "fly"));
  EXPECT_FALSE(animate(2, "go"));
  ASSERT_TRUE(editor.Apply({.id = 1, .op = UndoEdit{}}, kAnna, room, nullptr));
  EXPECT_EQ(editor.Message().objects[0].animation, "rise");
}

TEST(SceneEditor, MoreThan256ObjectsAreRefused) {
  Stage stage(SceneFrame::kWorld, 255);
  ASSERT_TRUE(stage.Do(AddObject{"vase.glb", {0, 0}}));
  const auto done = stage.Do(AddObject{"vase.glb", {0, 0}});
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("256"));
}

TEST(SceneEditor, TheHistoryIsBounded) {
  Stage stage;
  for (int i = 0; i < 500; ++i) ASSERT_TRUE(stage.Do(To(1, 0.01 * i, 0, 0)));
  int steps = 0;
  while (stage.Do(UndoEdit{})) ++steps;
  EXPECT_EQ(steps, 200);
}

TEST(SceneEditor, TheDefaultLightEntersTheSceneAtItsFirstChange) {
  Stage stage;
  ASSERT_EQ(stage.editor.Message().lights.size(), 1u);
  EXPECT_EQ(stage.editor.Message().lights[0].kind, "directional");
  EXPECT_TRUE(stage.editor.scene()->lights.empty());
  ASSERT_TRUE(stage.Do(ChangeLight{1, {}, {}, 2.0}));
  ASSERT_EQ(stage.editor.scene()->lights.size(), 1u);
  EXPECT_EQ(stage.editor.scene()->lights[0].intensity, 2.0f);
  EXPECT_EQ(stage.editor.scene()->ambient, (Ambient{0.4f, 0.2f})) << "what the room scatters stays as it was";
  ASSERT_TRUE(stage.Do(ChangeLight{1, {{0, 0, 5}}, {}, {}}));
  EXPECT_EQ(std::get<DirectionalLight>(stage.editor.scene()->lights[0].shape).toward_light,
            Eigen::Vector3d::UnitZ());
}

TEST(SceneEditor, UnsavedIsWhatTheFileDoesNotHold) {
  Stage stage;
  EXPECT_FALSE(stage.editor.Message().unsaved);
  ASSERT_TRUE(stage.Do(To(1, 1, 0, 0)));
  EXPECT_TRUE(stage.editor.Message().unsaved);
  stage.editor.MarkSaved();
  EXPECT_FALSE(stage.editor.Message().unsaved);
  EXPECT_EQ(stage.editor.Message().edits, 1u);
  ASSERT_TRUE(stage.Do(UndoEdit{}));
  EXPECT_EQ(stage.editor.Message().edits, 2u);
  EXPECT_TRUE(stage.editor.Message().unsaved);
  ASSERT_TRUE(stage.Do(RedoEdit{}));
  EXPECT_FALSE(stage.editor.Message().unsaved);
}

TEST(SceneEditor, RandomEditsOfTwoDirectorsAreUndoneToTheBeginning) {
  Stage stage;
  const std::string beginning = stage.Content();
  std::mt19937 random(11);
  const auto number = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  for (int i = 0; i < 150; ++i) {
    const auto object = static_cast<std::uint32_t>(random() % 5 + 1);
    const EditSource& source = random() % 2 ? kAnna : kBen;
    const EditOp ops[] = {To(object, number(-5, 5), number(-5, 5), 0), TurnObject{object, number(-180, 180)},
                          AddObject{"vase.glb", {number(0, 900), 0}},  DeleteObject{object},
                          ChangeLight{1, {}, {}, number(0, 2)},        UndoEdit{}};
    const EditOp& op = ops[random() % std::size(ops)];
    const bool live = random() % 2 == 0 && (std::holds_alternative<MoveObject>(op) || op.index() == 2);
    (void)stage.Do(op, live, source);  // some are refused
  }
  while (stage.Do(UndoEdit{})) {
  }
  EXPECT_EQ(stage.Content(), beginning);
  const WatchScene message = stage.editor.Message();
  EXPECT_TRUE(message.can_redo);
  EXPECT_FALSE(message.unsaved);
}

}  // namespace
}  // namespace mixstage
