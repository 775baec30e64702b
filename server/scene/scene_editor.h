// SPDX-License-Identifier: Apache-2.0
//
// The scene while a show edits it (SPEC.md 4.5): operations of several directors, undo and redo. Pure: the
// room, model files and the disk are the caller's (server/pipeline/director).
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/watch/scene_message.h"
#include "server/scene/edit_change.h"

namespace mixstage {

// Who sent an edit.
struct EditSource {
  std::uint64_t viewer = 0;  // the connection
  std::string name{};
};

struct SceneEditorLimits {
  std::size_t undo_steps = 200;
  double room_m = 100;  // no object or light farther than this from the scene's origin
};

// One thread at a time.
//
// Every accepted edit is one step of undo, whoever made it. Edits of a drag (`live`) change the scene at
// once; all of them and the last one, which is not live, are one step: a drag that is never ended, or into
// which somebody else's edit falls, ends as a step there.
class SceneEditor {
 public:
  // The scene's objects and lights have ids. `saved`: it is what its file holds.
  SceneEditor(Scene scene, DefaultLight default_light, SceneEditorLimits limits = {});

  // Does one edit, all of it or nothing: a refusal is kBadInput, a sentence for its author. model: for `add`,
  // else not read; thing: for `adopt`. `save` is the caller's: it is none of these ops here (checked).
  Status Apply(const WatchEdit& edit, const EditSource& source, const RoomProbe& room,
               const AddedModel* model = nullptr, const std::shared_ptr<const AdoptedThing>& thing = nullptr);

  // Where physics has brought objects since: no step of undo, nothing to save. Those that a person has put
  // somewhere since are left alone.
  void Follow(std::span<const MovedObject> moved);

  // The scene now: immutable; meshes are shared with all earlier ones. Every change raises its revision.
  [[nodiscard]] const std::shared_ptr<const Scene>& scene() const { return now_.scene; }
  // What viewers are told; `models` is left to the caller.
  [[nodiscard]] WatchScene Message();

  // The scene is on the disk as it is now.
  void MarkSaved() { saved_ = now_.content; }

 private:
  // A state of the scene. Undo and redo give a new revision to a content that was there before.
  struct Version {
    std::shared_ptr<const Scene> scene;
    std::uint64_t content = 0;
  };
  struct Drag {
    std::uint64_t viewer = 0;
    std::size_t op = 0;  // index of the variant
    std::uint32_t target = 0;
    bool operator==(const Drag&) const = default;
  };

  void MarkEdited(const EditSource& source);
  Status Step(std::vector<Version>& from, std::vector<Version>& to, const char* nothing);
  void CloseDrag();
  void PushUndo(Version before);
  void Become(Scene scene, std::uint64_t content);
  Stand StandOfObject(const SceneObject& object);

  const DefaultLight default_light_;
  const SceneEditorLimits limits_;
  Version now_;
  std::vector<Version> undo_, redo_;
  Version before_drag_;      // valid while drags_ holds any
  std::vector<Drag> drags_;  // edits that have been live since
  std::uint64_t revision_ = 0, content_ = 0, saved_ = 0;
  std::uint32_t last_object_id_ = 0;
  std::uint64_t last_put_ = 0;
  std::map<std::uint32_t, StandOf> stands_;
  std::string by_;
  std::uint64_t edits_ = 0;
};

}  // namespace mixstage
