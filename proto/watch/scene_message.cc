// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/scene_message.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <string_view>

#include "proto/watch/scene_fields.h"

namespace mixstage {
namespace {

using Json = nlohmann::json;

constexpr int kMaxId = std::numeric_limits<int>::max();

std::string Dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

double Finite(double value) { return std::isfinite(value) ? value : 0; }

template <std::size_t N>
Json List(const std::array<double, N>& numbers) {
  Json list = Json::array();
  for (const double number : numbers) list.push_back(Finite(number));
  return list;
}

// An id of an object or a light: 1 .. 2^31 - 1.
void ReadId(JsonReader& read, const char* name, std::uint32_t* id) {
  int value = 0;
  read.Int(name, 1, kMaxId, &value);
  *id = static_cast<std::uint32_t>(value);
}

void ReadPoint(JsonReader& read, PicturePoint* point) {
  read.Double("u", &point->u);
  read.Double("v", &point->v);
}

// Of what names nothing but an object.
template <typename Op>
EditOp ReadObject(JsonReader& read) {
  Op op;
  ReadId(read, "object", &op.object);
  return op;
}

EditOp ReadAdd(JsonReader& read) {
  AddObject add;
  read.Text("file", &add.file);
  ReadPoint(read, &add.at);
  return add;
}

EditOp ReadMove(JsonReader& read) {
  MoveObject move;
  ReadId(read, "object", &move.object);
  if (read.Has("position")) {
    if (read.Has("u") || read.Has("v")) {
      read.Refuse("position", "stands beside u, v: give one or the other");
      return move;
    }
    ToPosition to;
    read.Numbers("position", to.position);
    move.to = to;
    return move;
  }
  PicturePoint at;
  ReadPoint(read, &at);
  move.to = ToSurface{at};
  if (!read.Has("on")) return move;
  read.Choice("on", {"floor"});
  move.to = AlongFloor{at};
  return move;
}

EditOp ReadTurn(JsonReader& read) {
  TurnObject turn;
  ReadId(read, "object", &turn.object);
  read.Double("angle_deg", &turn.angle_deg);
  return turn;
}

EditOp ReadHide(JsonReader& read) {
  HideObject hide;
  ReadId(read, "object", &hide.object);
  read.Bool("hidden", &hide.hidden);
  return hide;
}

EditOp ReadAnimate(JsonReader& read) {
  AnimateObject animate;
  ReadId(read, "object", &animate.object);
  read.Text("animation", &animate.animation);
  return animate;
}

EditOp ReadLight(JsonReader& read) {
  ChangeLight light;
  ReadId(read, "light", &light.light);
  if (read.Has("position")) read.Numbers("position", light.position.emplace());
  if (read.Has("color")) read.Numbers("color", light.color.emplace());
  if (read.Has("intensity")) read.Double("intensity", &light.intensity.emplace());
  if (!light.position && !light.color && !light.intensity) {
    read.Refuse("light", "comes without position, color or intensity");
  }
  return light;
}

EditOp ReadAvatar(JsonReader& read) {
  PlaceAvatar place;
  if (read.Has("position")) read.Numbers("position", place.position.emplace());
  if (read.Has("turn_deg")) read.Double("turn_deg", &place.turn_deg.emplace());
  if (!place.position && !place.turn_deg) read.Refuse("avatar", "comes without position or turn_deg");
  return place;
}

EditOp ReadAdopt(JsonReader& read) {
  AdoptThing adopt;
  ReadPoint(read, &adopt.at);
  return adopt;
}

// Of what says all by its name.
template <typename Op>
EditOp ReadBare(JsonReader&) {
  return Op{};
}

// In the order of EditOp.
struct OpFormat {
  const char* name;
  EditOp (*read)(JsonReader&);
};
constexpr std::array<OpFormat, std::variant_size_v<EditOp>> kOps = {{{"add", ReadAdd},
                                                                     {"move", ReadMove},
                                                                     {"turn", ReadTurn},
                                                                     {"drop", ReadObject<DropObject>},
                                                                     {"delete", ReadObject<DeleteObject>},
                                                                     {"hide", ReadHide},
                                                                     {"animate", ReadAnimate},
                                                                     {"light", ReadLight},
                                                                     {"avatar", ReadAvatar},
                                                                     {"adopt", ReadAdopt},
                                                                     {"forget", ReadBare<ForgetThings>},
                                                                     {"undo", ReadBare<UndoEdit>},
                                                                     {"redo", ReadBare<RedoEdit>},
                                                                     {"save", ReadBare<SaveScene>}}};

EditOp ReadOp(JsonReader& read) {
  static const auto names = [] {
    std::array<const char*, kOps.size()> all{};
    std::ranges::transform(kOps, all.begin(), &OpFormat::name);
    return all;
  }();
  return kOps[read.Choice("op", names)].read(read);
}

Result<std::vector<std::string>> ReadNames(const std::string& place, const Json& list) {
  std::vector<std::string> names;
  for (const Json& item : list) {
    if (!item.is_string() || item.get_ref<const std::string&>().size() > 1024)
      return Fail(ErrorCode::kBadInput, place + " holds something else than short names");
    names.push_back(item.get<std::string>());
  }
  return names;
}

Result<WatchObject> ReadObject(const Json& item) {
  WatchObject object;
  JsonReader read(item);
  ReadId(read, "id", &object.id);
  read.Text("name", &object.name);
  read.Text("file", &object.file);
  read.Numbers("pose", object.pose);
  read.Text("body", &object.body);
  read.Choice("body", {"isolated", "mutual", "actor"});
  read.Count("triangles", &object.triangles);
  read.Numbers("bounds", object.bounds);
  read.Numbers("base", object.base);
  read.Double("radius_m", &object.radius_m);
  read.Bool("hidden", &object.hidden);
  const Json* animations = nullptr;
  if (read.Has("animations")) {
    read.List("animations", kMaxAnimations, &animations);
    read.Text("animation", &object.animation);
  }
  if (!read.status()) return Within("objects", read.status().error());
  if (animations != nullptr) {
    auto names = ReadNames("objects: animations", *animations);
    if (!names) return tl::unexpected(names.error());
    object.animations = std::move(*names);
  }
  return object;
}

Result<WatchAvatar> ReadAvatarOf(const Json& item) {
  WatchAvatar avatar;
  JsonReader read(item);
  read.Numbers("anchor", avatar.anchor);
  read.Numbers("position", avatar.position);
  read.Double("turn_deg", &avatar.turn_deg);
  if (!read.status()) return Within("avatar", read.status().error());
  return avatar;
}

Result<WatchLight> ReadLightOf(const Json& item) {
  WatchLight light;
  JsonReader read(item);
  ReadId(read, "id", &light.id);
  read.Text("name", &light.name);
  read.Text("kind", &light.kind);
  read.Choice("kind", {"point", "area", "directional"});
  read.Numbers("position", light.position);
  read.Numbers("color", light.color);
  read.Double("intensity", &light.intensity);
  if (!read.status()) return Within("lights", read.status().error());
  return light;
}

// The fields of an op into the message around it.
struct PutOp {
  Json& json;
  void Point(const PicturePoint& at) const {
    json["u"] = Finite(at.u);
    json["v"] = Finite(at.v);
  }
  void operator()(const AddObject& add) const {
    json["file"] = add.file;
    Point(add.at);
  }
  void operator()(const ToSurface& to) const { Point(to.at); }
  void operator()(const AlongFloor& to) const {
    Point(to.at);
    json["on"] = "floor";
  }
  void operator()(const ToPosition& to) const { json["position"] = List(to.position); }
  void operator()(const MoveObject& move) const {
    json["object"] = move.object;
    std::visit(*this, move.to);
  }
  void operator()(const TurnObject& turn) const {
    json["object"] = turn.object;
    json["angle_deg"] = Finite(turn.angle_deg);
  }
  void operator()(const DropObject& drop) const { json["object"] = drop.object; }
  void operator()(const DeleteObject& gone) const { json["object"] = gone.object; }
  void operator()(const HideObject& hide) const {
    json["object"] = hide.object;
    json["hidden"] = hide.hidden;
  }
  void operator()(const AnimateObject& animate) const {
    json["object"] = animate.object;
    json["animation"] = animate.animation;
  }
  void operator()(const ChangeLight& light) const {
    json["light"] = light.light;
    if (light.position) json["position"] = List(*light.position);
    if (light.color) json["color"] = List(*light.color);
    if (light.intensity) json["intensity"] = Finite(*light.intensity);
  }
  void operator()(const PlaceAvatar& place) const {
    if (place.position) json["position"] = List(*place.position);
    if (place.turn_deg) json["turn_deg"] = Finite(*place.turn_deg);
  }
  void operator()(const AdoptThing& adopt) const { Point(adopt.at); }
  void operator()(const ForgetThings&) const {}
  void operator()(const UndoEdit&) const {}
  void operator()(const RedoEdit&) const {}
  void operator()(const SaveScene&) const {}
};

}  // namespace

const char* OpName(const EditOp& op) { return kOps[op.index()].name; }

std::string ToJson(const WatchScene& scene) {
  Json objects = Json::array();
  for (const WatchObject& object : scene.objects) {
    objects.push_back({{"id", object.id},
                       {"name", object.name},
                       {"file", object.file},
                       {"pose", List(object.pose)},
                       {"body", object.body},
                       {"triangles", object.triangles},
                       {"bounds", List(object.bounds)},
                       {"base", List(object.base)},
                       {"radius_m", Finite(object.radius_m)},
                       {"hidden", object.hidden}});
    if (object.animations.empty()) continue;
    objects.back()["animations"] = object.animations;
    objects.back()["animation"] = object.animation;
  }
  Json lights = Json::array();
  for (const WatchLight& light : scene.lights) {
    lights.push_back({{"id", light.id},
                      {"name", light.name},
                      {"kind", light.kind},
                      {"position", List(light.position)},
                      {"color", List(light.color)},
                      {"intensity", Finite(light.intensity)}});
  }
  Json json({{"type", "scene"},
             {"revision", scene.revision},
             {"frame", scene.frame},
             {"up", List(scene.up)},
             {"can_undo", scene.can_undo},
             {"can_redo", scene.can_redo},
             {"unsaved", scene.unsaved},
             {"by", scene.by},
             {"edits", scene.edits},
             {"objects", std::move(objects)},
             {"lights", std::move(lights)},
             {"models", scene.models}});
  if (scene.adopted > 0) json["adopted"] = scene.adopted;
  if (const auto& avatar = scene.avatar) {
    json["avatar"] = {{"anchor", List(avatar->anchor)},
                      {"position", List(avatar->position)},
                      {"turn_deg", Finite(avatar->turn_deg)}};
  }
  return Dump(json);
}

std::string ToJson(const WatchRefused& refused) {
  return Dump({{"type", "refused"}, {"id", refused.id}, {"reason", refused.reason}});
}

std::string ToJson(const WatchEdit& edit) {
  Json json = {{"type", "edit"}, {"id", edit.id}, {"op", OpName(edit.op)}};
  if (edit.live) json["live"] = true;
  std::visit(PutOp{json}, edit.op);
  return Dump(json);
}

Result<WatchScene> ReadScene(const JsonFields& fields) {
  WatchScene scene;
  const Json *objects = nullptr, *lights = nullptr, *models = nullptr, *avatar = nullptr;
  JsonReader read(fields);
  read.Count("revision", &scene.revision);
  read.Text("frame", &scene.frame);
  read.Choice("frame", {"world", "camera"});
  read.Numbers("up", scene.up);
  read.Bool("can_undo", &scene.can_undo);
  read.Bool("can_redo", &scene.can_redo);
  read.Bool("unsaved", &scene.unsaved);
  read.Text("by", &scene.by);
  read.Count("edits", &scene.edits);
  read.List("objects", kMaxSceneObjects, &objects);
  read.List("lights", kMaxSceneLights, &lights);
  read.List("models", kMaxSceneModels, &models);
  if (read.Has("avatar")) read.Object("avatar", &avatar);
  if (read.Has("adopted")) read.Count("adopted", &scene.adopted);
  if (!read.status()) return Within("scene", read.status().error());
  if (avatar != nullptr) {
    Result<WatchAvatar> read_avatar = ReadAvatarOf(*avatar);
    if (!read_avatar) return Within("scene", read_avatar.error());
    scene.avatar = *read_avatar;
  }
  for (const Json& item : *objects) {
    Result<WatchObject> object = ReadObject(item);
    if (!object) return Within("scene", object.error());
    scene.objects.push_back(std::move(*object));
  }
  for (const Json& item : *lights) {
    Result<WatchLight> light = ReadLightOf(item);
    if (!light) return Within("scene", light.error());
    scene.lights.push_back(std::move(*light));
  }
  auto names = ReadNames("scene: models", *models);
  if (!names) return tl::unexpected(names.error());
  scene.models = std::move(*names);
  return scene;
}

Result<WatchRefused> ReadRefused(const JsonFields& fields) {
  WatchRefused refused;
  JsonReader read(fields);
  read.Int("id", 0, kMaxId, &refused.id);
  read.Text("reason", &refused.reason);
  if (!read.status()) return Within("refused", read.status().error());
  return refused;
}

Result<WatchEdit> ReadEdit(const JsonFields& fields) {
  WatchEdit edit;
  JsonReader read(fields);
  read.Int("id", 0, kMaxId, &edit.id);
  if (read.Has("live")) read.Bool("live", &edit.live);
  edit.op = ReadOp(read);
  const bool draggable =
      std::holds_alternative<MoveObject>(edit.op) || std::holds_alternative<TurnObject>(edit.op) ||
      std::holds_alternative<ChangeLight>(edit.op) || std::holds_alternative<PlaceAvatar>(edit.op);
  if (edit.live && !draggable) read.Refuse("live", "belongs to move, turn, light and avatar alone");
  if (!read.status()) return Within("edit", read.status().error());
  return edit;
}

}  // namespace mixstage
