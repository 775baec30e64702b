// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "server/scene/scene_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto scene = ParseScene(std::string(reinterpret_cast<const char*>(data), size), "scene.yaml");
  if (!scene) {
    MIX_CHECK(!scene.error().message.empty());
    return 0;
  }
  for (const SceneDescription::Object& object : scene->objects) {
    MIX_CHECK(!object.file.empty());
    MIX_CHECK((object.pose ? *object.pose : TSceneObject(object.placing, UpAxis::kY)).matrix().allFinite());
  }
  return 0;
}
