// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_write.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "proto/base/file_bytes.h"
#include "server/scene/scene_file.h"
#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

using testing::HasSubstr;

constexpr const char* kTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

std::string TextOf(const std::filesystem::path& file) {
  const auto bytes = ReadFileBytes(file, 1 << 20);
  return bytes ? std::string(bytes->begin(), bytes->end()) : "";
}

Scene Loaded(const std::filesystem::path& file) {
  auto scene = LoadScene(file, LoadModel);
  EXPECT_TRUE(scene) << scene.error().message;
  return scene ? scene->scene : Scene{};
}

void ExpectEqual(const Scene& a, const Scene& b) {
  EXPECT_EQ(a.avatar, b.avatar);
  EXPECT_EQ(a.frame, b.frame);
  EXPECT_EQ(a.ambient, b.ambient);
  ASSERT_EQ(a.objects.size(), b.objects.size());
  for (std::size_t i = 0; i < a.objects.size(); ++i) {
    SCOPED_TRACE(a.objects[i].name);
    EXPECT_EQ(a.objects[i].id, b.objects[i].id);
    EXPECT_EQ(a.objects[i].name, b.objects[i].name);
    EXPECT_EQ(a.objects[i].file, b.objects[i].file);
    EXPECT_EQ(a.objects[i].T_scene_object.matrix(), b.objects[i].T_scene_object.matrix());
    EXPECT_EQ(a.objects[i].placing, b.objects[i].placing);
    EXPECT_EQ(a.objects[i].body, b.objects[i].body);
    EXPECT_EQ(a.objects[i].drop, b.objects[i].drop);
    EXPECT_EQ(a.objects[i].hidden, b.objects[i].hidden);
    EXPECT_EQ(a.objects[i].clip, b.objects[i].clip);
    EXPECT_EQ(a.objects[i].mass_kg, b.objects[i].mass_kg);
  }
  ASSERT_EQ(a.lights.size(), b.lights.size());
  for (std::size_t i = 0; i < a.lights.size(); ++i) {
    SCOPED_TRACE(a.lights[i].name);
    EXPECT_EQ(a.lights[i].id, b.lights[i].id);
    EXPECT_EQ(a.lights[i].name, b.lights[i].name);
    EXPECT_EQ(a.lights[i].color, b.lights[i].color);
    EXPECT_EQ(a.lights[i].intensity, b.lights[i].intensity);
    ASSERT_EQ(a.lights[i].shape.index(), b.lights[i].shape.index());
    if (const auto* sun = std::get_if<DirectionalLight>(&a.lights[i].shape)) {
      EXPECT_EQ(sun->toward_light, std::get<DirectionalLight>(b.lights[i].shape).toward_light);
    } else if (const auto* area = std::get_if<AreaLight>(&a.lights[i].shape)) {
      const auto& other = std::get<AreaLight>(b.lights[i].shape);
      EXPECT_EQ(area->center, other.center);
      EXPECT_EQ(area->edge_u, other.edge_u);
      EXPECT_EQ(area->edge_v, other.edge_v);
    } else {
      EXPECT_EQ(std::get<PointLight>(a.lights[i].shape).position,
                std::get<PointLight>(b.lights[i].shape).position);
    }
  }
  EXPECT_EQ(a.reactions, b.reactions);
  ASSERT_EQ(a.reflectors.size(), b.reflectors.size());
  for (std::size_t i = 0; i < a.reflectors.size(); ++i) {
    EXPECT_EQ(a.reflectors[i].name, b.reflectors[i].name);
    EXPECT_EQ(a.reflectors[i].surface, b.reflectors[i].surface);
    EXPECT_EQ(a.reflectors[i].plane, b.reflectors[i].plane);
    EXPECT_EQ(a.reflectors[i].polygon, b.reflectors[i].polygon);
    EXPECT_EQ(a.reflectors[i].color, b.reflectors[i].color);
    EXPECT_EQ(a.reflectors[i].reflectivity, b.reflectors[i].reflectivity);
    EXPECT_EQ(a.reflectors[i].roughness, b.reflectors[i].roughness);
  }
}

TEST(SceneWrite, WhatIsSavedIsReadBackNumberByNumber) {
  const test::TemporaryFolder folder;
  folder.Write("a.obj", kTriangle);
  const auto file = folder.Write("scene.yaml", R"(
frame: world
ambient: [0.3, 0.1]
objects:
  - {name: "quo\"te \\ \x07 umlaut ä: # -", file: a.obj, pose: [2, 0.1, 0, 1, 0, 2, 0.3333333333333333, 2, 0, 0, 2, 3e-7, 0, 0, 0, 1], drop: true, body: actor, mass_kg: 2.7}
  - {name: "true", file: a.obj, position: [0.1, 0.2, 0.7], rotation_deg: [10, 20, 30.1], scale: 0.3, up: z, hidden: true, body: isolated}
  - {name: c, file: a.obj}
lights:
  - {name: lamp, kind: area, center: [0, 0.1, 3], edge_u: [0.2, 0, 0], edge_v: [0, -1, 0], color: [1, 0.9, 0.8], intensity: 20.3}
  - {name: sun, kind: directional, preset: W, intensity: 0.1}
  - {name: low, kind: directional, direction: [0.3, 0.2, -0.1]}
  - {name: bulb, kind: point, position: [1, 1, 2.2]}
reflectors:
  - {name: desk, plane: [0.1, 0.2, 2, -1.5], polygon: [[0, 0, 0.75], [1, 0, 0.75], [0, 1.1, 0.75]], reflectivity: 0.15, roughness: 0.1}
  - {name: marble, plane: [0, 0, 1, 0], polygon: [[0, 0, 0], [1, 0, 0], [0, 1.1, 0]], color: [0.1, 0.2, 0.7], reflectivity: 0.3}
  - {name: table, surface: "table \"1\"", roughness: 0.2}
reactions:
  - {object: c, meets: floor, after_s: 2.5, put_back: "true"}
  - {object: c, meets: "true", least_impulse_ns: 0.3, light: bulb, intensity: 0.7}
  - {object: c, meets: actor, message: "# \"ouch\""}
)");
  Scene scene = Loaded(file);
  ASSERT_EQ(scene.objects.size(), 3u);
  ASSERT_EQ(scene.reactions.size(), 3u);
  scene.avatar = Avatar{.room = "../a \"hall\"",
                        .video = {},
                        .poses = {},
                        .anchor = {3.1, 0.3},
                        .position = {0.1, 0.2, 0.7},
                        .turn_deg = -30.1,
                        .camera = AvatarCamera{{0, 0.1, 1.5}, {4.1, 0, 1.5}, 60.1}};
  ASSERT_TRUE(WriteScene(scene, file));
  const Scene again = Loaded(file);
  ExpectEqual(scene, again);
  const std::string text = TextOf(file);
  ASSERT_TRUE(WriteScene(again, file));
  EXPECT_EQ(TextOf(file), text);
}

TEST(SceneWrite, AnimationsAreSavedByName) {
  const test::TemporaryFolder folder;
  folder.Write("a.glb", test::MovingTriangle("translation", {1, 0, 0, 1, 0, 4}));
  const auto file = folder.Write("scene.yaml", R"(
objects:
  - {name: a, file: a.glb}
  - {name: b, file: a.glb, animation: go}
  - {name: c, file: a.glb, animation: none}
reactions:
  - {object: a, meets: floor, play: go}
  - {object: a, meets: actor, play: none, of: c}
)");
  const Scene scene = Loaded(file);
  ASSERT_EQ(scene.objects.size(), 3u);
  EXPECT_EQ(scene.objects[0].clip, 0);
  EXPECT_EQ(scene.objects[1].clip, 0);
  EXPECT_EQ(scene.objects[2].clip, -1);
  EXPECT_EQ(std::get<PlayAnimation>(scene.reactions.at(0).action), (PlayAnimation{"a", "go"}));
  ASSERT_TRUE(WriteScene(scene, file));
  ExpectEqual(scene, Loaded(file));
}

TEST(SceneWrite, RandomScenesComeBackNumberByNumber) {
  const test::TemporaryFolder folder;
  folder.Write("a.obj", kTriangle);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(-9, 9);
  for (int i = 0; i < 20; ++i) {
    Scene scene;
    scene.frame = i % 2 == 0 ? SceneFrame::kWorld : SceneFrame::kCamera;
    for (std::uint32_t id = 1; id <= 8; ++id) {
      SceneObject object;
      object.id = id;
      object.name = std::to_string(id);
      object.file = "a.obj";
      if (id % 2 == 0) {
        object.placing = Placing{{number(random), number(random), number(random)},
                                 {number(random), number(random), number(random)},
                                 std::abs(number(random)) + 0.01,
                                 {}};
        object.T_scene_object = TSceneObject(*object.placing, UpAxis::kY);
      } else {
        object.T_scene_object.linear().setRandom();
        object.T_scene_object.translation().setRandom();
      }
      scene.objects.push_back(object);
      Light light{.id = id, .name = object.name, .shape = PointLight{}};
      light.shape = DirectionalLight{Eigen::Vector3d::Random().normalized()};
      light.color = Eigen::Vector3f::Random().cwiseAbs();
      light.intensity = std::abs(static_cast<float>(number(random)));
      scene.lights.push_back(light);
    }
    const auto file = folder.path() / "scene.yaml";
    const auto saved = WriteScene(scene, file);
    ASSERT_TRUE(saved) << saved.error().message;
    ExpectEqual(scene, Loaded(file));
  }
}

TEST(SceneWrite, TheFileBeforeIsKept) {
  const test::TemporaryFolder folder;
  const std::string before = "# my comment\nframe: world\n";
  const auto file = folder.Write("scene.yaml", before);
  ASSERT_TRUE(WriteScene(Scene{}, file));
  EXPECT_EQ(TextOf(folder.path() / "scene.yaml.bak"), before);
  EXPECT_THAT(TextOf(file), HasSubstr(".bak"));
  std::size_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) ++files;
  EXPECT_EQ(files, 2u) << "nothing else is left behind";
}

TEST(SceneWrite, AFolderThatIsNotThereIsSaid) {
  const auto saved = WriteScene(Scene{}, "/nowhere/at/all/scene.yaml");
  ASSERT_FALSE(saved);
  EXPECT_EQ(saved.error().code, ErrorCode::kUnavailable);
  EXPECT_THAT(saved.error().message, HasSubstr("/nowhere/at/all/scene.yaml"));
}

TEST(SceneWrite, ALinkedSceneStaysLinked) {
  const test::TemporaryFolder folder;
  folder.Write("real.yaml", "frame: camera\n");
  const auto link = folder.path() / "scene.yaml";
  std::filesystem::create_symlink("real.yaml", link);
  ASSERT_TRUE(WriteScene(Scene{}, link));
  EXPECT_TRUE(std::filesystem::is_symlink(link));
  EXPECT_THAT(TextOf(folder.path() / "real.yaml"), HasSubstr("frame: world"));
}

}  // namespace
}  // namespace mixstage
