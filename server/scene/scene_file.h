// SPDX-License-Identifier: Apache-2.0
//
// scene.yaml: which models stand where, lights and reflectors (FORMATS section 4). A person edits it: an
// unknown key, a missing file, a number that is none or a pose that squeezes an object flat is an error that
// names file, line and key.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "server/scene/model_file.h"
#include "server/scene/scene.h"

namespace mixstage {

struct LoadedScene {
  Scene scene;
  std::vector<std::string> warnings;  // keys without effect yet, what importers left out
};

// Reads the file and every model it names. At most 1 MB, 256 objects, 64 lights, 16 reflectors.
Result<LoadedScene> LoadScene(const std::filesystem::path& file);

// How an object is placed when no pose is given: the file's up axis is turned to z, then Rz Ry Rx, scale,
// shift.
struct Placing {
  std::array<double, 3> position{};      // m, scene frame
  std::array<double, 3> rotation_deg{};  // about x, y, z
  double scale = 1.0;                    // > 0
  std::optional<UpAxis> up;              // nothing: as usual for the kind of file
};
[[nodiscard]] Eigen::Affine3d TSceneObject(const Placing& placing, UpAxis usual_up);

// What scene.yaml says, before any model is read. place: "scene.yaml" for messages.
struct SceneDescription {
  struct Object {
    std::string name, file;
    int line = 0;
    std::optional<Eigen::Affine3d> pose;
    Placing placing;
    Body body = Body::kMutual;
    bool drop = false;
    double mass_kg = 1.0;
  };
  SceneFrame frame = SceneFrame::kWorld;
  std::vector<Object> objects;
  std::vector<Light> lights;
  std::vector<Reflector> reflectors;
  std::vector<std::string> warnings;
};
Result<SceneDescription> ParseScene(const std::string& yaml_text, const std::string& place);

}  // namespace mixstage
