// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_file.h"

#include <map>
#include <numbers>

namespace mixstage {
namespace {

constexpr std::size_t kSceneBytes = 1u << 20;
constexpr std::size_t kSceneTriangles = 2 * ModelLimits::kTriangles;  // instances counted: they are all drawn

}  // namespace

Eigen::Vector3d UpOf(SceneFrame frame) {
  return frame == SceneFrame::kWorld ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d(-Eigen::Vector3d::UnitY());
}

Eigen::Affine3d TSceneObject(const Placing& placing, UpAxis usual_up) {
  constexpr double kRadPerDeg = std::numbers::pi / 180.0;
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.translate(Eigen::Vector3d(placing.position[0], placing.position[1], placing.position[2]));
  T.rotate(Eigen::AngleAxisd(placing.rotation_deg[2] * kRadPerDeg, Eigen::Vector3d::UnitZ()));
  T.rotate(Eigen::AngleAxisd(placing.rotation_deg[1] * kRadPerDeg, Eigen::Vector3d::UnitY()));
  T.rotate(Eigen::AngleAxisd(placing.rotation_deg[0] * kRadPerDeg, Eigen::Vector3d::UnitX()));
  T.scale(placing.scale);
  // y to z about x: (x, y, z) -> (x, -z, y).
  if (placing.up.value_or(usual_up) == UpAxis::kY) {
    T.rotate(Eigen::AngleAxisd(0.5 * std::numbers::pi, Eigen::Vector3d::UnitX()));
  }
  return T;
}

Result<LoadedScene> LoadScene(const std::filesystem::path& file) {
  auto bytes = ReadFileBytes(file, kSceneBytes);
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
  loaded.scene.reflectors = std::move(description->reflectors);
  for (SceneDescription::Object& object : description->objects) {
    const std::string place =
        file.string() + ":" + std::to_string(object.line) + ": object " + object.name + ": file";
    const std::filesystem::path path = file.parent_path() / object.file;
    auto found = models.find(path.lexically_normal().string());
    if (found == models.end()) {
      auto model = LoadModel(path);
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
    if (triangles > kSceneTriangles) {
      return Fail(ErrorCode::kBadInput, place + " takes the scene over 20 million triangles");
    }
    SceneObject placed;
    placed.id = static_cast<std::uint32_t>(loaded.scene.objects.size() + 1);
    placed.name = std::move(object.name);
    placed.file = std::move(object.file);
    placed.mesh = found->second.mesh;
    placed.T_scene_object = object.pose ? *object.pose : TSceneObject(object.placing, found->second.up);
    placed.body = object.body;
    placed.drop = object.drop;
    placed.mass_kg = object.mass_kg;
    loaded.scene.objects.push_back(std::move(placed));
  }
  return loaded;
}

}  // namespace mixstage
