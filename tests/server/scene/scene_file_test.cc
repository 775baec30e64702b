// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using testing::HasSubstr;

SceneDescription Parsed(const std::string& text) {
  auto scene = ParseScene(text, "scene.yaml");
  EXPECT_TRUE(scene) << scene.error().message;
  return scene ? *scene : SceneDescription{};
}

TEST(SceneFile, ReadsEveryKey) {
  const SceneDescription scene = Parsed(R"(
version: 1
frame: world
objects:
  - {name: statue, file: statue.glb, pose: [2, 0, 0, 1, 0, 2, 0, 2, 0, 0, 2, 3, 0, 0, 0, 1], drop: true, body: actor, mass_kg: 2.5}
  - {name: cup, file: cup.ply, position: [1, 2, 3], rotation_deg: [0, 0, 90], scale: 0.5, up: z}
lights:
  - {name: lamp, kind: area, center: [0, 0, 3], edge_u: [0.2, 0, 0], edge_v: [0, -1, 0], color: [1, 0.9, 0.8], intensity: 20}
  - {name: sun, kind: directional, preset: W, color: [1, 1, 1], intensity: 0.5}
  - {name: bulb, kind: point, position: [1, 1, 2]}
reflectors:
  - {name: desk, plane: [0, 0, 2, -1.5], polygon: [[0, 0, 0.75], [1, 0, 0.75], [0, 1, 0.75]], reflectivity: 0.15, roughness: 0.1}
  - {plane: [0, 0, 1, 0], polygon: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], color: [0.1, 0.2, 0.3]}
)");
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_EQ(*scene.objects[0].pose * Eigen::Vector3d(1, 1, 1), Eigen::Vector3d(3, 4, 5));
  EXPECT_EQ(scene.objects[0].body, Body::kActor);
  EXPECT_EQ(scene.objects[1].body, Body::kMutual);
  EXPECT_EQ(scene.objects[0].mass_kg, 2.5);
  EXPECT_EQ(scene.objects[1].placing.up, UpAxis::kZ);
  ASSERT_EQ(scene.lights.size(), 3u);
  EXPECT_FLOAT_EQ(scene.lights[0].Strength().y(), 18.0f);
  const auto& sun = std::get<DirectionalLight>(scene.lights[1].shape);
  EXPECT_LT((sun.toward_light - Eigen::Vector3d(-1, 0, 1).normalized()).norm(), 1e-12);
  EXPECT_EQ(std::get<PointLight>(scene.lights[2].shape).position, Eigen::Vector3d(1, 1, 2));
  EXPECT_DOUBLE_EQ(scene.reflectors[0].plane[3], -0.75);  // of unit normal
  EXPECT_FALSE(scene.reflectors[0].color);
  ASSERT_EQ(scene.reflectors.size(), 2u);
  EXPECT_EQ(scene.reflectors[1].color, Eigen::Vector3f(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(scene.reflectors[1].reflectivity, 0.04);
  EXPECT_EQ(scene.warnings.size(), 0u);
}

TEST(SceneFile, ReadsAnAvatar) {
  const SceneDescription scene = Parsed(R"(
avatar:
  room: ../hall
  anchor: [3, 1]
  position: [1, 2, 0.5]
  turn_deg: 90
  camera: {position: [0, 0, 1.5], look_at: [4, 0, 1.5], view_deg: 60}
)");
  ASSERT_TRUE(scene.avatar);
  EXPECT_EQ(scene.avatar->room, "../hall");
  // The anchor goes where it was told to, what stood a metre along x beside it a metre along y.
  EXPECT_LT((scene.avatar->TTargetWorld() * Eigen::Vector3d(3, 1, 0) - Eigen::Vector3d(1, 2, 0.5)).norm(),
            1e-12);
  EXPECT_LT((scene.avatar->TTargetWorld() * Eigen::Vector3d(4, 1, 0) - Eigen::Vector3d(1, 3, 0.5)).norm(),
            1e-12);
  ASSERT_TRUE(scene.avatar->camera);
  const auto pose = TTargetView(*scene.avatar->camera);
  ASSERT_TRUE(pose);
  EXPECT_LT((*pose * Eigen::Vector3d(0, 0, 4) - Eigen::Vector3d(4, 0, 1.5)).norm(), 1e-12);
  EXPECT_LT((pose->linear().col(1) + Eigen::Vector3d::UnitZ()).norm(), 1e-12);  // y points down
  EXPECT_FALSE(Parsed("version: 1\n").avatar);
  const SceneDescription here = Parsed("avatar: {anchor: [3, 1]}\n");
  EXPECT_TRUE(here.avatar->TTargetWorld().isApprox(RigidTransform::Identity()));
}

TEST(SceneFile, PresetsOfACameraSceneComeFromAboveInItsOwnFrame) {
  const SceneDescription scene = Parsed("frame: camera\nlights:\n  - {kind: directional, preset: N}\n");
  const auto& light = std::get<DirectionalLight>(scene.lights.at(0).shape);
  EXPECT_LT((light.toward_light - Eigen::Vector3d(0, -1, 1).normalized()).norm(), 1e-12);  // y points down
}

TEST(SceneFile, PositionTurnsTheFilesUpToZThenRotates) {
  Placing placing;
  placing.position = {1, 0, 0};
  placing.rotation_deg = {0, 0, 90};
  placing.scale = 2;
  // The file's up (y) ends up at z; its front (z) at -y, which 90 degrees about z turn to +x.
  EXPECT_LT((TSceneObject(placing, UpAxis::kY) * Eigen::Vector3d(0, 1, 0) - Eigen::Vector3d(1, 0, 2)).norm(),
            1e-12);
  EXPECT_LT((TSceneObject(placing, UpAxis::kY) * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(3, 0, 0)).norm(),
            1e-12);
  EXPECT_LT((TSceneObject(placing, UpAxis::kZ) * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1, 0, 2)).norm(),
            1e-12);
}

struct Mistake {
  const char *text, *message;
};
class SceneMistake : public testing::TestWithParam<Mistake> {};

TEST_P(SceneMistake, IsNamedByFileLineAndKey) {
  auto scene = ParseScene(GetParam().text, "scene.yaml");
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr(GetParam().message));
  EXPECT_EQ(scene.error().code, ErrorCode::kInvalidConfig);
}
INSTANTIATE_TEST_SUITE_P(
    Table, SceneMistake,
    testing::Values(
        Mistake{"version: 1\nobjetcs: []\n", "scene.yaml:2: unknown key objetcs"},
        Mistake{"objects:\n  - name: a\n    file: a.glb\n    colour: red\n",
                "scene.yaml:4: unknown key objects[0].colour"},
        Mistake{"version: 2\n", "scene.yaml:1: version is not 1"},
        Mistake{"avatar: 3\n", "avatar is not a mapping"},
        Mistake{"frame: camera\navatar: {}\n", "scene.yaml:2: avatar needs frame: world"},
        Mistake{"avatar:\n  room: a\n  video: b\n", "scene.yaml:3: avatar.video stands beside room"},
        Mistake{"avatar: {poses: a}\n", "avatar.poses belongs to video"},
        Mistake{"avatar: {positon: [1, 2, 0]}\n", "unknown key avatar.positon"},
        Mistake{"avatar: {position: [1, 2]}\n", "avatar.position is not a list of 3 numbers"},
        Mistake{"avatar: {turn_deg: 400}\n", "avatar.turn_deg is outside -360..360"},
        Mistake{"avatar: {camera: {position: [0, 0, 1]}}\n", "avatar.camera.look_at is missing"},
        Mistake{"avatar: {camera: {position: [0, 0, 1], look_at: [0, 0, 0]}}\n",
                "avatar.camera.look_at looks straight up or down"},
        Mistake{"avatar: {camera: {position: [0, 0, 1], look_at: [1, 0, 1], view_deg: 170}}\n",
                "avatar.camera.view_deg is outside 5..120"},
        Mistake{"avatar: {video: a, camera: {position: [0, 0, 1], look_at: [1, 0, 1]}}\n",
                "avatar.camera stands beside video"},
        Mistake{"frame: table\n", "scene.yaml:1: frame is none of world, camera"},
        Mistake{"objects:\n  - name: a\n", "scene.yaml:2: objects[0].file is missing"},
        Mistake{"objects:\n  - {file: a.glb, position: [1, .nan, 2]}\n",
                "objects[0].position [1] is not a finite number"},
        Mistake{"objects:\n  - {file: a.glb, position: [1, 2]}\n",
                "objects[0].position is not a list of 3 numbers"},
        Mistake{"objects:\n  - {file: a.glb, scale: 0}\n", "objects[0].scale is outside"},
        Mistake{"objects:\n  - {file: a.glb, scale: 1e999}\n", "objects[0].scale is not a finite number"},
        Mistake{"objects:\n  - {file: a.glb, pose: [1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]}\n",
                "objects[0].pose squeezes the object flat"},
        Mistake{"objects:\n  - {file: a.glb, pose: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,1,1]}\n", "last row"},
        Mistake{"objects:\n  - {file: a.glb, pose: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], scale: 2}\n",
                "objects[0].scale stands beside pose"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\n  - {name: a, file: b.glb}\n",
                "scene.yaml:3: objects[1].name is the name of another"},
        Mistake{"objects:\n  - {file: a.glb, body: ghost}\n",
                "objects[0].body is none of isolated, mutual, actor"},
        Mistake{"objects:\n  - {file: a.glb, mass_kg: -1}\n", "objects[0].mass_kg is outside"},
        Mistake{"objects:\n  - {file: a.glb, drop: maybe}\n", "objects[0].drop is neither true nor false"},
        Mistake{"objects:\n  - {file: a.glb, file: b.glb}\n", "objects[0].file is given twice"},
        Mistake{"objects: {file: a.glb}\n", "objects is not a list"},
        Mistake{"lights:\n  - {kind: area, center: [0,0,0], edge_u: [1,0,0], edge_v: [2,0,0]}\n",
                "lights[0].edge_u and edge_v span no area"},
        Mistake{"lights:\n  - {kind: directional}\n", "needs preset or direction"},
        Mistake{"lights:\n  - {kind: directional, preset: N, center: [0,0,0]}\n",
                "unknown key lights[0].center"},
        Mistake{"lights:\n  - {kind: point, position: [0,0,0], intensity: -1}\n",
                "lights[0].intensity is outside"},
        Mistake{"lights:\n  - {name: a}\n", "lights[0].kind is missing"},
        Mistake{"reflectors:\n  - {name: a}\n", "reflectors[0].plane or surface: give one of them"},
        Mistake{"reflectors:\n  - {surface: floor, plane: [0, 0, 1, 0]}\n", "reflectors[0].plane or surface"},
        Mistake{"reflectors:\n  - {surface: floor, color: [1, 1, 1]}\n", "unknown key reflectors[0].color"},
        Mistake{"frame: camera\nreflectors:\n  - {surface: floor}\n",
                "reflectors[0].surface needs frame: world"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 0, 1]}\n", "reflectors[0].plane has a normal of length 0"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 1, 0], polygon: [[0, 0], [1, 1], [2, 2]]}\n",
                "reflectors[0].polygon has a corner that is not three"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 1, .nan]}\n", "reflectors[0].plane"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 1, 0], reflectivity: 1.1}\n",
                "reflectors[0].reflectivity is outside 0..1"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 1, 0], roughness: -0.1}\n",
                "reflectors[0].roughness is outside 0..1"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 1, 0], polygon: [[0, 0, 0], [1, 1, 0], [2, 2, 0]]}\n",
                "reflectors[0].polygon spans no area"},
        Mistake{
            "reflectors:\n  - {plane: [0, 0, 1, 0.7], polygon: [[0, 0, 0.7], [1, 0, 0.7], [1, 1, 0.7]]}\n",
            "reflectors[0].polygon has a corner that is more than 0.2 m off the plane"},
        Mistake{"reflectors:\n  - {plane: [0, 0, 1, 0], color: [1, 1, 1]}\n",
                "reflectors[0].polygon is missing"},
        Mistake{
            "reflectors:\n  - {plane: [0, 0, 1, 0], color: [1, 1, 2], polygon: [[0, 0, 0], [1, 0, 0], [1, 1, "
            "0]]}\n",
            "reflectors[0].color has a number outside 0..1"},
        Mistake{
            "reflectors:\n  - {plane: [0, 0, 1, 0], color: [1, 1, 1], polygon: [[0, 0, 0], [2, 0, 0], [2, 2, "
            "0], [1.5, 0.5, 0]]}\n",
            "reflectors[0].polygon is not convex"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\nreactions:\n  - {object: a, meets: floor, play: x, "
                "of: b}\n",
                "reactions[0].of names no object: b"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\nreactions:\n  - {object: a, meets: floor, message: x, "
                "of: a}\n",
                "reactions[0].of belongs to play"},
        Mistake{"reactions:\n  - {object: a, meets: floor, message: x}\n",
                "reactions[0].object names no object: a"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\nreactions:\n  - {object: a, message: x}\n",
                "reactions[0].meets is missing"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\nreactions:\n  - {object: a, meets: b}\n",
                "reacts by message, light, put_back or play"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\nreactions:\n  - {object: a, meets: b, light: sun, "
                "intensity: 1}\n",
                "reactions[0].light names no light of the scene: sun"},
        Mistake{"objects:\n  - {name: a, file: a.glb}\nreactions:\n  - {object: a, meets: b, message: x, "
                "after_s: -1}\n",
                "reactions[0].after_s is outside"},
        Mistake{"a: [1, 2\nb: }\n", "scene.yaml:2"}, Mistake{"- 1\n- 2\n", "the file is not a mapping"},
        Mistake{"", "scene.yaml"}));

TEST(SceneFile, ACommaWithoutBracketsEnds) {
  auto scene = ParseScene(", objects: []\n", "scene.yaml");  // YAML::LoadAll never came back from it
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("one YAML document"));
  EXPECT_FALSE(ParseScene("version: 1\n---\nversion: 1\n", "scene.yaml"));
  EXPECT_FALSE(ParseScene("", "scene.yaml"));
}

TEST(SceneFile, NestingAndSizeAreBounded) {
  EXPECT_FALSE(ParseScene("objects: " + std::string(200000, '['), "scene.yaml"));
  std::string many = "objects:\n";
  for (int i = 0; i < 300; ++i) many += "  - {file: a.glb}\n";
  auto scene = ParseScene(many, "scene.yaml");
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("more than 256"));
}

TEST(SceneFile, MissingModelNamesObjectAndFile) {
  test::TemporaryFolder folder;
  auto scene =
      LoadScene(folder.Write("scene.yaml", "objects:\n  - {name: statue, file: gone.glb}\n"), LoadModel);
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("scene.yaml:2: object statue: file"));
  EXPECT_THAT(scene.error().message, HasSubstr("gone.glb: is missing"));
}

TEST(SceneFile, AnAnimationThatTheFileDoesNotHaveIsNamedWithThoseThatItHas) {
  test::TemporaryFolder folder;
  folder.Write("a.glb", test::MovingTriangle("translation", {1, 0, 0, 1, 0, 4}));
  folder.Write("b.glb", test::Glb(test::TriangleJson(), test::TriangleBinary()));
  const auto why = [&](const std::string& text) {
    const auto scene = LoadScene(folder.Write("scene.yaml", text), LoadModel);
    return scene ? std::string("loaded") : scene.error().message;
  };
  EXPECT_THAT(
      why("objects:\n  - {name: door, file: a.glb, animation: open}\n"),
      HasSubstr("scene.yaml:2: object door: animation: \"open\" is no animation of its file, which has go"));
  EXPECT_THAT(why("objects:\n  - {name: door, file: b.glb, animation: open}\n"), HasSubstr("which has none"));
  EXPECT_EQ(why("objects:\n  - {name: door, file: b.glb, animation: none}\n"), "loaded");
  EXPECT_THAT(why("objects:\n  - {name: door, file: a.glb}\nreactions:\n  - {object: door, meets: actor, "
                  "play: open}\n"),
              HasSubstr("reaction of door: play: \"open\" is no animation"));
}

TEST(SceneFile, ObjectsOfOneFileShareTheirMesh) {
  test::TemporaryFolder folder;
  folder.Write("t.glb", test::Glb(test::TriangleJson(), test::TriangleBinary()));
  auto scene = LoadScene(
      folder.Write("scene.yaml",
                   "objects:\n  - {name: a, file: t.glb}\n  - {name: b, file: t.glb, position: [1, 0, 0]}\n"),
      LoadModel);
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(scene->scene.objects[0].mesh, scene->scene.objects[1].mesh);
}

}  // namespace
}  // namespace mixstage
