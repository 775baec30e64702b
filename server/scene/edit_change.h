// SPDX-License-Identifier: Apache-2.0
//
// What each op of an edit does to a scene (SPEC.md 4.5). The editor gives it a copy: one that was refused
// half way is thrown away.
#pragma once

#include <cstdint>
#include <map>
#include <memory>

#include "proto/base/result.h"
#include "proto/watch/scene_message.h"
#include "server/scene/mesh.h"
#include "server/scene/object_stand.h"
#include "server/scene/placing.h"
#include "server/scene/room_probe.h"
#include "server/scene/scene.h"

namespace mixstage {

// A model that `add` puts into the scene.
struct AddedModel {
  std::shared_ptr<const Mesh> mesh;
  UpAxis up = UpAxis::kY;
};

// The lights of a scene that names none, shown and edited like any other; the first change writes them into
// the scene.
struct DefaultLight {
  std::vector<Light> lights;
  std::optional<Ambient> ambient;
};

// What an op reads beside the scene, and what the editor keeps for it from one edit to the next.
struct EditContext {
  const RoomProbe& room;
  const AddedModel* model;                           // for `add`
  const std::shared_ptr<const AdoptedThing>& thing;  // for `adopt`
  const DefaultLight& default_light;
  double room_m;                             // no object or light farther than this from the origin
  std::map<std::uint32_t, StandOf>& stands;  // by object
  std::uint32_t& last_object_id;             // raised by `add`
  std::uint64_t& last_put;                   // SceneObject::put, raised by whatever puts an object somewhere
};

// Fails with kBadInput, a sentence for the author. Undo, redo and save are none of these ops (checked).
Status ChangeScene(const EditOp& op, Scene& scene, const EditContext& context);

}  // namespace mixstage
