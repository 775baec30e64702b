// SPDX-License-Identifier: Apache-2.0
#include "server/scene/scene_editor.h"

#include <algorithm>
#include <utility>

namespace mixstage {
namespace {

tl::unexpected<Error> Refuse(std::string sentence) { return Fail(ErrorCode::kBadInput, std::move(sentence)); }

std::array<double, 3> ToArray(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

const char* BodyName(Body body) {
  switch (body) {
    case Body::kIsolated:
      return "isolated";
    case Body::kMutual:
      return "mutual";
    case Body::kActor:
      break;
  }
  return "actor";
}

const char* KindName(const Light& light) {
  constexpr const char* kNames[] = {"point", "directional", "area"};
  return kNames[light.shape.index()];
}

// Where a light is moved by: a directional light, which is nowhere, by the unit vector toward it.
Eigen::Vector3d PositionOf(const Light& light) {
  if (const auto* point = std::get_if<PointLight>(&light.shape)) return point->position;
  if (const auto* area = std::get_if<AreaLight>(&light.shape)) return area->center;
  return std::get<DirectionalLight>(light.shape).toward_light;
}

// What an edit's drag drags.
std::uint32_t TargetOf(const EditOp& op) {
  if (const auto* move = std::get_if<MoveObject>(&op)) return move->object;
  if (const auto* turn = std::get_if<TurnObject>(&op)) return turn->object;
  if (const auto* light = std::get_if<ChangeLight>(&op)) return light->light;
  return 0;
}

}  // namespace

SceneEditor::SceneEditor(Scene scene, DefaultLight default_light, SceneEditorLimits limits)
    : default_light_(std::move(default_light)), limits_(limits), revision_(scene.revision) {
  for (const SceneObject& object : scene.objects) {
    last_object_id_ = std::max(last_object_id_, object.id);
    last_put_ = std::max(last_put_, object.put);
  }
  now_.scene = std::make_shared<const Scene>(std::move(scene));
}

Status SceneEditor::Apply(const WatchEdit& edit, const EditSource& source, const RoomProbe& room,
                          const AddedModel* model, const std::shared_ptr<const AdoptedThing>& thing) {
  if (std::holds_alternative<UndoEdit>(edit.op) || std::holds_alternative<RedoEdit>(edit.op)) {
    CloseDrag();
    const bool undo = std::holds_alternative<UndoEdit>(edit.op);
    const Status done = undo ? Step(undo_, redo_, "There is nothing to undo.")
                             : Step(redo_, undo_, "There is nothing to redo.");
    if (done) MarkEdited(source);
    return done;
  }
  const Drag drag{source.viewer, edit.op.index(), TargetOf(edit.op)};
  const bool dragged = std::ranges::find(drags_, drag) != drags_.end();
  Scene changed = *now_.scene;
  const Status done = ChangeScene(edit.op, changed,
                                  {.room = room,
                                   .model = model,
                                   .thing = thing,
                                   .default_light = default_light_,
                                   .room_m = limits_.room_m,
                                   .stands = stands_,
                                   .last_object_id = last_object_id_,
                                   .last_put = last_put_});
  if (!done) {
    if (dragged && !edit.live) CloseDrag();  // it ended where it was last
    return done;
  }
  if (edit.live) {
    if (drags_.empty()) before_drag_ = now_;
    if (!dragged) drags_.push_back(drag);
    Become(std::move(changed), ++content_);
  } else if (dragged) {
    Become(std::move(changed), ++content_);
    CloseDrag();
  } else {
    CloseDrag();
    PushUndo(now_);
    // What the room is made of is no part of the scene's file.
    const bool in_file =
        !std::holds_alternative<AdoptThing>(edit.op) && !std::holds_alternative<ForgetThings>(edit.op);
    Become(std::move(changed), in_file ? ++content_ : now_.content);
  }
  redo_.clear();
  MarkEdited(source);
  return {};
}

void SceneEditor::MarkEdited(const EditSource& source) {
  by_ = source.name;
  ++edits_;
}

Status SceneEditor::Step(std::vector<Version>& from, std::vector<Version>& to, const char* nothing) {
  if (from.empty()) return Refuse(nothing);
  to.push_back(now_);
  const Version back = std::move(from.back());
  from.pop_back();
  Become(*back.scene, back.content);
  return {};
}

void SceneEditor::Follow(std::span<const MovedObject> moved) {
  Scene scene = *now_.scene;
  bool any = false;
  for (const MovedObject& move : moved) {
    const auto object = std::ranges::find(scene.objects, move.object, &SceneObject::id);
    if (object == scene.objects.end() || object->put != move.put) continue;
    any = true;
    object->T_scene_object = move.T_scene_object;
    if (!object->placing) continue;
    object->placing = PlacingOf(move.T_scene_object, *object->placing, object->usual_up);
    object->T_scene_object = TSceneObject(*object->placing, object->usual_up);
  }
  if (any) Become(std::move(scene), now_.content);
}

void SceneEditor::CloseDrag() {
  if (drags_.empty()) return;
  drags_.clear();
  PushUndo(std::exchange(before_drag_, {}));
}

void SceneEditor::PushUndo(Version before) {
  if (undo_.size() >= limits_.undo_steps) undo_.erase(undo_.begin());
  undo_.push_back(std::move(before));
}

void SceneEditor::Become(Scene scene, std::uint64_t content) {
  scene.revision = ++revision_;
  now_ = {std::make_shared<const Scene>(std::move(scene)), content};
  std::erase_if(stands_, [&](const auto& entry) {
    return std::ranges::find(now_.scene->objects, entry.first, &SceneObject::id) == now_.scene->objects.end();
  });
}

Stand SceneEditor::StandOfObject(const SceneObject& object) {
  return stands_[object.id](object.mesh, object.T_scene_object, UpOf(now_.scene->frame));
}

WatchScene SceneEditor::Message() {
  const Scene& scene = *now_.scene;
  WatchScene message;
  message.revision = scene.revision;
  message.frame = scene.frame == SceneFrame::kWorld ? "world" : "camera";
  message.up = ToArray(UpOf(scene.frame));
  message.can_undo = !undo_.empty() || !drags_.empty();
  message.can_redo = !redo_.empty();
  message.unsaved = now_.content != saved_;
  message.by = by_;
  message.edits = edits_;
  for (const SceneObject& object : scene.objects) {
    WatchObject out;
    out.id = object.id;
    out.name = object.name;
    out.file = object.file;
    Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(out.pose.data()) =
        object.T_scene_object.matrix();
    out.body = BodyName(object.body);
    out.triangles = object.mesh->triangle_count();
    const Stand stand = StandOfObject(object);
    for (int i = 0; i < 3; ++i) {
      out.bounds[static_cast<std::size_t>(i)] = stand.bounds.min()[i];
      out.bounds[static_cast<std::size_t>(i + 3)] = stand.bounds.max()[i];
    }
    out.base = ToArray(stand.base);
    out.radius_m = stand.radius_m;
    out.hidden = object.hidden;
    if (const auto& motion = object.mesh->motion) {
      for (const MotionClip& clip : motion->clips) out.animations.push_back(clip.name);
      out.animation = ClipName(*motion, object.clip);
    }
    message.objects.push_back(std::move(out));
  }
  message.adopted = scene.adopted.size();
  if (const auto& avatar = scene.avatar) {
    message.avatar = {{avatar->anchor.x(), avatar->anchor.y()}, ToArray(avatar->position), avatar->turn_deg};
  }
  for (const Light& light : scene.lights.empty() ? default_light_.lights : scene.lights) {
    message.lights.push_back({.id = light.id,
                              .name = light.name,
                              .kind = KindName(light),
                              .position = ToArray(PositionOf(light)),
                              .color = ToArray(light.color.cast<double>()),
                              .intensity = light.intensity});
  }
  return message;
}

}  // namespace mixstage
