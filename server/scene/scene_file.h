// SPDX-License-Identifier: Apache-2.0
//
// scene.yaml: which models stand where, lights, reflectors and where the actor is put (FORMATS section 4;
// SPEC.md 10). A person edits it: an unknown key, a missing file, a number that is none or a pose that
// squeezes an object flat is an error that names file, line and key.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "server/scene/model_file.h"
#include "server/scene/placing.h"
#include "server/scene/scene.h"

namespace mixstage {

struct LoadedScene {
  Scene scene;
  std::vector<std::string> warnings;  // keys without effect yet, what importers left out
};

inline constexpr std::size_t kSceneFileBytes = 1u << 20;
inline constexpr std::size_t kMaxSceneTriangles = 2 * ModelLimits::kTriangles;  // instances counted

// Reads the file and, by `load`, every model it names. At most 1 MB, 256 objects, 64 lights, 16 reflectors,
// 64 reactions. Objects and lights get the ids 1, 2, ... in the file's order.
Result<LoadedScene> LoadScene(const std::filesystem::path& file, const ModelLoader& load);

// What scene.yaml says, before any model is read. place: "scene.yaml" for messages.
struct SceneDescription {
  struct Object {
    std::string name, file;
    int line = 0;
    std::optional<Eigen::Affine3d> pose;
    Placing placing;
    Body body = Body::kMutual;
    bool drop = false;
    bool hidden = false;
    std::optional<std::string> animation;  // by name; nothing: the file's first
    double mass_kg = 1.0, friction = 0.5, restitution = 0.1;
  };
  SceneFrame frame = SceneFrame::kWorld;
  std::vector<Object> objects;
  std::vector<Light> lights;
  std::optional<Ambient> ambient;
  std::vector<Reflector> reflectors;
  std::vector<Reaction> reactions;
  std::optional<Avatar> avatar;
  std::vector<std::string> warnings;
};
Result<SceneDescription> ParseScene(const std::string& yaml_text, const std::string& place);

}  // namespace mixstage
