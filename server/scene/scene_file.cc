// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_file.h"

#include <algorithm>
#include <map>

namespace mixstage {
namespace {

// -1: none. A sentence's end where the file has no such animation.
Result<int> ClipOf(const Mesh& mesh, const std::string& name) {
  std::string names;
  if (mesh.motion != nullptr) {
    if (const auto clip = FindClip(*mesh.motion, name)) return *clip;
    for (const MotionClip& clip : mesh.motion->clips) names += (names.empty() ? "" : ", ") + clip.name;
  } else if (name == kNoClip) {
    return 0;
  }
  return Fail(ErrorCode::kInvalidConfig,
              "\"" + name + "\" is no animation of its file, which has " + (names.empty() ? "none" : names));
}

}  // namespace

Eigen::Vector3d UpOf(SceneFrame frame) {
  return frame == SceneFrame::kWorld ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d(-Eigen::Vector3d::UnitY());
}

Result<LoadedScene> LoadScene(const std::filesystem::path& file, const ModelLoader& load) {
  auto bytes = ReadFileBytes(file, kSceneFileBytes);
  if (!bytes) return Fail(ErrorCode::kInvalidConfig, file.string() + " " + bytes.error().message);
  auto description = ParseScene(std::string(bytes->begin(), bytes->end()), file.string());
  if (!description) return tl::unexpected(description.error());

  struct Model {
    std::shared_ptr<const Mesh> mesh;
    UpAxis up;
  };
  std::map<std::string, Model> models;
  std::size_t triangles = 0;
  LoadedScene loaded;
  loaded.warnings = std::move(description->warnings);
  loaded.scene.frame = description->frame;
  loaded.scene.lights = std::move(description->lights);
  for (std::uint32_t id = 1; Light & light : loaded.scene.lights) light.id = id++;
  loaded.scene.ambient = description->ambient;
  loaded.scene.reflectors = std::move(description->reflectors);
  loaded.scene.reactions = std::move(description->reactions);
  loaded.scene.avatar = std::move(description->avatar);
  for (SceneDescription::Object& object : description->objects) {
    const std::string place =
        file.string() + ":" + std::to_string(object.line) + ": object " + object.name + ": file";
    const std::filesystem::path path = file.parent_path() / object.file;
    auto found = models.find(path.lexically_normal().string());
    if (found == models.end()) {
      auto model = load(path);
      if (!model) return Within(place, model.error());
      for (const std::string& warning : model->warnings) {
        loaded.warnings.push_back("object " + object.name + ": " + object.file + ": " + warning);
      }
      found = models
                  .emplace(path.lexically_normal().string(),
                           Model{std::make_shared<const Mesh>(std::move(model->mesh)), model->up})
                  .first;
    }
    triangles += found->second.mesh->triangle_count();
    if (triangles > kMaxSceneTriangles) {
      return Fail(ErrorCode::kBadInput, place + " takes the scene over 20 million triangles");
    }
    SceneObject placed;
    placed.id = static_cast<std::uint32_t>(loaded.scene.objects.size() + 1);
    placed.name = std::move(object.name);
    placed.file = std::move(object.file);
    placed.mesh = found->second.mesh;
    placed.usual_up = found->second.up;
    if (!object.pose) placed.placing = object.placing;
    placed.T_scene_object = object.pose ? *object.pose : TSceneObject(object.placing, found->second.up);
    if (object.animation) {
      const auto clip = ClipOf(*placed.mesh, *object.animation);
      if (!clip) {
        return Within(
            file.string() + ":" + std::to_string(object.line) + ": object " + placed.name + ": animation",
            clip.error());
      }
      placed.clip = *clip;
    }
    placed.hidden = object.hidden;
    placed.body = object.body;
    placed.put = 1;
    placed.drop = object.drop;
    placed.mass_kg = object.mass_kg;
    placed.friction = object.friction;
    placed.restitution = object.restitution;
    loaded.scene.objects.push_back(std::move(placed));
  }
  for (const Reaction& reaction : loaded.scene.reactions) {
    const auto* play = std::get_if<PlayAnimation>(&reaction.action);
    if (play == nullptr) continue;
    const auto object = std::ranges::find(loaded.scene.objects, play->object, &SceneObject::name);
    if (auto clip = ClipOf(*object->mesh, play->clip); !clip)
      return Within(file.string() + ": reaction of " + reaction.object + ": play", clip.error());
  }
  return loaded;
}

}  // namespace mixstage
