// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <set>

#include "proto/geometry/frames.h"
#include "server/scene/scene_file.h"
#include "server/scene/yaml_fields.h"

namespace mixstage {
namespace {

constexpr std::size_t kMostObjects = 256;
constexpr std::size_t kMostLights = 64;
constexpr std::size_t kMostReflectors = 16;
constexpr std::size_t kMostReactions = 64;
constexpr std::size_t kMostCorners = 256;
constexpr double kFarthest = 1e5;  // m
constexpr double kOffPlane_m = 0.2;
constexpr double kStraight = 1e-9;  // m^2

Eigen::Vector3d ToVector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

// A length that only rounding keeps from 1 is left alone: what was written by us comes back bit by bit.
bool IsOne(double length) { return std::abs(length - 1.0) < 1e-14; }
Eigen::Vector3d OfLengthOne(const Eigen::Vector3d& v) { return IsOne(v.norm()) ? v : v.normalized(); }

Status All(std::initializer_list<Status> steps) {
  for (const Status& step : steps) {
    if (!step) return step;
  }
  return {};
}

Status ReadPlacing(YamlFields& f, SceneDescription::Object& object) {
  if (f.Has("pose")) {
    for (const char* key : {"position", "rotation_deg", "scale", "up"}) {
      if (f.Has(key)) return f.Bad(key, "stands beside pose: give one or the other");
    }
    std::array<double, 16> numbers{};
    if (auto ok = f.Numbers("pose", numbers); !ok) return ok;
    auto pose = AffineFromRowMajor(numbers);
    if (!pose) return f.Bad("pose", pose.error().message);
    if (pose->matrix().cwiseAbs().maxCoeff() > kFarthest) return f.Bad("pose", "has a number over 100000");
    object.pose = *pose;
    return {};
  }
  std::size_t up = 0;
  if (auto ok = All({f.Numbers("position", object.placing.position),
                     f.Numbers("rotation_deg", object.placing.rotation_deg),
                     f.Number("scale", object.placing.scale), f.Choice("up", {"", "y", "z"}, up)});
      !ok) {
    return ok;
  }
  if (!(object.placing.scale >= 1e-4 && object.placing.scale <= 1e4))
    return f.Bad("scale", "is outside 0.0001..10000");
  if (ToVector(object.placing.position).cwiseAbs().maxCoeff() > kFarthest)
    return f.Bad("position", "has a number over 100000");
  if (up != 0) object.placing.up = up == 1 ? UpAxis::kY : UpAxis::kZ;
  return {};
}

Status ReadObject(YamlFields& f, std::size_t number, SceneDescription& scene) {
  SceneDescription::Object object;
  object.line = f.line();
  object.name = "object " + std::to_string(number + 1);
  std::size_t body = 1;
  std::string animation;
  if (auto ok = All({f.Text("name", object.name), f.Text("file", object.file), f.Flag("drop", object.drop),
                     f.Flag("hidden", object.hidden), f.Text("animation", animation),
                     f.Choice("body", {"isolated", "mutual", "actor"}, body),
                     f.NumberIn("mass_kg", 0.001, 10'000, object.mass_kg),
                     f.NumberIn("friction", 0, 2, object.friction),
                     f.NumberIn("restitution", 0, 1, object.restitution), ReadPlacing(f, object),
                     f.CheckAllKnown()});
      !ok) {
    return ok;
  }
  if (object.file.empty()) return f.Bad("file", "is missing");
  object.body = static_cast<Body>(body + 1);
  if (f.Has("animation")) object.animation = animation;
  for (const auto& other : scene.objects) {
    if (other.name == object.name) return f.Bad("name", "is the name of another object: " + object.name);
  }
  scene.objects.push_back(std::move(object));
  return {};
}

Status ReadDirectional(YamlFields& f, SceneFrame frame, Light& light) {
  DirectionalLight sun;
  if (f.Has("preset") == f.Has("direction"))
    return f.Bad("kind", "directional needs preset or direction, one of them");
  std::size_t preset = 0;
  std::array<double, 3> direction{};
  if (auto ok = All({f.Choice("preset", {"N", "E", "S", "W"}, preset), f.Numbers("direction", direction)});
      !ok)
    return ok;
  if (f.Has("direction")) {
    if (!(ToVector(direction).norm() > 1e-6)) return f.Bad("direction", "has length 0");
    sun.toward_light = -OfLengthOne(ToVector(direction));  // the file says where the light travels
  } else {
    // N = +y, E = +x, S = -y, W = -x of the world; of a camera scene N = away from the camera (z), E = right
    // (x).
    const Eigen::Vector3d north =
        frame == SceneFrame::kWorld ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d east = Eigen::Vector3d::UnitX();
    const Eigen::Vector3d from[] = {north, east, -north, -east};
    sun.toward_light = (from[preset] + UpOf(frame)).normalized();
  }
  light.shape = sun;
  return {};
}

Status ReadArea(YamlFields& f, Light& light) {
  std::array<double, 3> center{};
  std::array<double, 3> edge_u{};
  std::array<double, 3> edge_v{};
  for (const char* key : {"center", "edge_u", "edge_v"}) {
    if (!f.Has(key)) return f.Bad(key, "is missing: an area light needs center, edge_u, edge_v");
  }
  if (auto ok = All({f.Numbers("center", center), f.Numbers("edge_u", edge_u), f.Numbers("edge_v", edge_v)});
      !ok)
    return ok;
  AreaLight area{ToVector(center), ToVector(edge_u), ToVector(edge_v)};
  if (!(area.edge_u.cross(area.edge_v).norm() > 1e-9)) return f.Bad("edge_u", "and edge_v span no area");
  light.shape = area;
  return {};
}

Status ReadLight(YamlFields& f, std::size_t number, SceneDescription& scene) {
  Light light;
  light.name = "light " + std::to_string(number + 1);
  std::size_t kind = 3;
  std::array<double, 3> color{1, 1, 1};
  double intensity = 1;
  if (auto ok = All({f.Text("name", light.name), f.Choice("kind", {"point", "directional", "area"}, kind),
                     f.Numbers("color", color), f.NumberIn("intensity", 0, 1e6, intensity)});
      !ok) {
    return ok;
  }
  for (const double c : color) {
    if (!(c >= 0 && c <= 1e6)) return f.Bad("color", "has a number outside 0..1000000");
  }
  light.color = ToVector(color).cast<float>();
  light.intensity = static_cast<float>(intensity);
  Status shape;
  if (kind == 0) {
    std::array<double, 3> position{};
    if (!f.Has("position")) return f.Bad("position", "is missing: a point light needs it");
    shape = f.Numbers("position", position);
    light.shape = PointLight{ToVector(position)};
  } else if (kind == 1) {
    shape = ReadDirectional(f, scene.frame, light);
  } else if (kind == 2) {
    shape = ReadArea(f, light);
  } else {
    return f.Bad("kind", "is missing (point, directional or area)");
  }
  if (!shape) return shape;
  scene.lights.push_back(std::move(light));
  return f.CheckAllKnown();
}

Status CheckPolygon(const YamlFields& f, const Reflector& reflector) {
  const std::vector<Eigen::Vector3d>& polygon = reflector.polygon;
  const Eigen::Vector3d normal = reflector.plane.head<3>();
  const std::size_t n = polygon.size();
  Eigen::Vector3d twice_area = Eigen::Vector3d::Zero();
  bool left = false, right = false;
  for (std::size_t i = 0; i < n; ++i) {
    const double off = std::abs(normal.dot(polygon[i]) + reflector.plane.w());
    if (off > kOffPlane_m) return f.Bad("polygon", "has a corner that is more than 0.2 m off the plane");
    const Eigen::Vector3d edge = polygon[(i + 1) % n] - polygon[i];
    twice_area += (polygon[i] - polygon[0]).cross(edge);
    const double turn = normal.dot(edge.cross(polygon[(i + 2) % n] - polygon[(i + 1) % n]));
    left = left || turn > kStraight;
    right = right || turn < -kStraight;
  }
  if (!(std::abs(normal.dot(twice_area)) > 1e-9)) return f.Bad("polygon", "spans no area");
  if (reflector.color && left && right)
    return f.Bad("polygon", "is not convex, as a patch with color must be");
  return {};
}

Status ReadReflector(YamlFields& f, std::size_t number, SceneDescription& scene) {
  Reflector reflector;
  reflector.name = "reflector " + std::to_string(number + 1);
  std::array<double, 4> plane{};
  if (f.Has("plane") == f.Has("surface")) return f.Bad("plane", "or surface: give one of them");
  if (auto ok = All({f.Text("name", reflector.name), f.Text("surface", reflector.surface),
                     f.Numbers("plane", plane), f.NumberIn("reflectivity", 0, 1, reflector.reflectivity),
                     f.NumberIn("roughness", 0, 1, reflector.roughness)});
      !ok) {
    return ok;
  }
  if (f.Has("surface")) {
    if (scene.frame != SceneFrame::kWorld) return f.Bad("surface", "needs frame: world");
    scene.reflectors.push_back(std::move(reflector));
    return f.CheckAllKnown();
  }
  if (f.Has("color")) {
    std::array<double, 3> color{};
    if (auto ok = f.Numbers("color", color); !ok) return ok;
    for (const double c : color) {
      if (!(c >= 0 && c <= 1)) return f.Bad("color", "has a number outside 0..1");
    }
    if (!f.Has("polygon")) return f.Bad("polygon", "is missing: a patch with color needs it");
    reflector.color = ToVector(color).cast<float>();
  }
  reflector.plane = Eigen::Vector4d(plane[0], plane[1], plane[2], plane[3]);
  const double length = reflector.plane.head<3>().norm();
  if (!(length > 1e-9)) return f.Bad("plane", "has a normal of length 0");
  if (!(std::abs(reflector.plane.w()) <= kFarthest * length))
    return f.Bad("plane", "is farther than 100000 m from the origin");
  if (!IsOne(length)) reflector.plane /= length;
  if (f.Has("polygon")) {
    const YAML::Node polygon = f.Raw("polygon");
    if (!polygon.IsSequence() || polygon.size() < 3 || polygon.size() > kMostCorners) {
      return f.Bad("polygon", "is not a list of 3 to 256 points");
    }
    for (const YAML::Node& corner : polygon) {
      Eigen::Vector3d point;
      bool good = corner.IsSequence() && corner.size() == 3;
      for (std::size_t k = 0; good && k < 3; ++k) good = YamlNumber(corner[k], point[static_cast<int>(k)]);
      if (!good) return f.Bad("polygon", "has a corner that is not three finite numbers");
      if (point.cwiseAbs().maxCoeff() > kFarthest) return f.Bad("polygon", "has a number over 100000");
      reflector.polygon.push_back(point);
    }
    if (auto ok = CheckPolygon(f, reflector); !ok) return ok;
  }
  scene.reflectors.push_back(std::move(reflector));
  return f.CheckAllKnown();
}

Status ReadAvatarCamera(YamlFields& f, Avatar& avatar) {
  std::array<double, 3> position{};
  std::array<double, 3> look_at{};
  double view_deg = 0;
  for (const char* key : {"position", "look_at"}) {
    if (!f.Has(key)) return f.Bad(key, "is missing: a camera needs position and look_at");
  }
  if (auto ok = All({f.Numbers("position", position), f.Numbers("look_at", look_at)}); !ok) return ok;
  AvatarCamera camera{ToVector(position), ToVector(look_at), std::nullopt};
  if (camera.position.cwiseAbs().maxCoeff() > kFarthest) return f.Bad("position", "has a number over 100000");
  if (camera.look_at.cwiseAbs().maxCoeff() > kFarthest) return f.Bad("look_at", "has a number over 100000");
  if (auto pose = TTargetView(camera); !pose) return f.Bad("look_at", pose.error().message);
  if (f.Has("view_deg")) {
    if (auto ok = f.NumberIn("view_deg", 5, 120, view_deg); !ok) return ok;
    camera.view_deg = view_deg;
  }
  avatar.camera = camera;
  return f.CheckAllKnown();
}

Status ReadAvatar(YamlFields& root, SceneDescription& scene) {
  if (!root.Has("avatar")) return {};
  auto f = root.Map("avatar");
  if (!f) return tl::unexpected(f.error());
  if (scene.frame != SceneFrame::kWorld) return root.Bad("avatar", "needs frame: world");
  Avatar avatar;
  std::array<double, 2> anchor{};
  std::array<double, 3> position{};
  if (auto ok = All({f->Text("room", avatar.room), f->Text("video", avatar.video),
                     f->Text("poses", avatar.poses), f->Numbers("anchor", anchor),
                     f->Numbers("position", position), f->NumberIn("turn_deg", -360, 360, avatar.turn_deg)});
      !ok) {
    return ok;
  }
  if (!avatar.room.empty() && !avatar.video.empty())
    return f->Bad("video", "stands beside room: give one or the other");
  if (avatar.video.empty() && !avatar.poses.empty()) return f->Bad("poses", "belongs to video");
  avatar.anchor = {anchor[0], anchor[1]};
  // He walks from the anchor where nothing else is said.
  avatar.position = f->Has("position") ? ToVector(position) : Eigen::Vector3d(anchor[0], anchor[1], 0);
  if (avatar.anchor.cwiseAbs().maxCoeff() > kFarthest) return f->Bad("anchor", "has a number over 100000");
  if (avatar.position.cwiseAbs().maxCoeff() > kFarthest)
    return f->Bad("position", "has a number over 100000");
  if (f->Has("camera")) {
    if (!avatar.video.empty()) return f->Bad("camera", "stands beside video: a video has its own");
    auto camera = f->Map("camera");
    if (!camera) return tl::unexpected(camera.error());
    if (auto ok = ReadAvatarCamera(*camera, avatar); !ok) return ok;
  }
  scene.avatar = std::move(avatar);
  return f->CheckAllKnown();
}

Status ReadAmbient(YamlFields& root, SceneDescription& scene) {
  if (!root.Has("ambient")) return {};
  std::array<double, 2> levels{};
  if (auto ok = root.Numbers("ambient", levels); !ok) return ok;
  if (!(levels[0] >= 0 && levels[0] <= 100 && levels[1] >= 0 && levels[1] <= 100)) {
    return root.Bad("ambient", "has a number outside 0..100");
  }
  scene.ambient = Ambient{static_cast<float>(levels[0]), static_cast<float>(levels[1])};
  return {};
}

Status ReadReaction(YamlFields& f, std::size_t, SceneDescription& scene) {
  Reaction reaction;
  SendMessage message;
  DimLight dim;
  PutBack back;
  PlayAnimation play;
  double intensity = 0;
  if (auto ok = All({f.Text("object", reaction.object), f.Text("meets", reaction.meets),
                     f.NumberIn("least_impulse_ns", 0, 1e6, reaction.least_impulse_ns),
                     f.NumberIn("after_s", 0, 3600, reaction.after_s), f.Text("message", message.text),
                     f.Text("light", dim.light), f.NumberIn("intensity", 0, 1e6, intensity),
                     f.Text("put_back", back.object), f.Text("play", play.clip), f.Text("of", play.object)});
      !ok)
    return ok;
  dim.intensity = static_cast<float>(intensity);
  const auto names = [&](const auto& list, const std::string& name) {
    return std::ranges::any_of(list, [&](const auto& entry) { return entry.name == name; });
  };
  for (const char* key : {"object", "meets"}) {
    if (!f.Has(key)) return f.Bad(key, "is missing: a reaction needs object and meets");
  }
  if (!names(scene.objects, reaction.object)) return f.Bad("object", "names no object: " + reaction.object);
  if (f.Has("message") + f.Has("light") + f.Has("put_back") + f.Has("play") != 1)
    return f.Bad("object", "reacts by message, light, put_back or play, one of them");
  if (f.Has("of") && !f.Has("play")) return f.Bad("of", "belongs to play");
  if (f.Has("light") != f.Has("intensity")) return f.Bad("light", "and intensity belong together");
  if (f.Has("message")) {
    reaction.action = message;
  } else if (f.Has("light")) {
    if (!names(scene.lights, dim.light)) return f.Bad("light", "names no light of the scene: " + dim.light);
    reaction.action = dim;
  } else if (f.Has("play")) {
    if (play.object.empty()) play.object = reaction.object;
    if (!names(scene.objects, play.object)) return f.Bad("of", "names no object: " + play.object);
    reaction.action = play;
  } else {
    if (!names(scene.objects, back.object)) return f.Bad("put_back", "names no object: " + back.object);
    reaction.action = back;
  }
  scene.reactions.push_back(std::move(reaction));
  return f.CheckAllKnown();
}

template <typename Read>
Status ReadList(YamlFields& root, const char* key, std::size_t limit, SceneDescription& scene, Read read) {
  auto entries = root.List(key, limit);
  if (!entries) return tl::unexpected(entries.error());
  for (std::size_t i = 0; i < entries->size(); ++i) {
    if (auto ok = read((*entries)[i], i, scene); !ok) return ok;
  }
  return {};
}

Result<SceneDescription> Parse(const std::string& text, const std::string& place) {
  auto root = ParseYaml(text, place);
  if (!root) return tl::unexpected(root.error());
  SceneDescription scene;
  double version = 1;
  std::size_t frame = 0;
  if (auto ok = All({root->Number("version", version), root->Choice("frame", {"world", "camera"}, frame)});
      !ok) {
    return tl::unexpected(ok.error());
  }
  if (version != 1) return root->Bad("version", "is not 1");
  scene.frame = frame == 0 ? SceneFrame::kWorld : SceneFrame::kCamera;
  if (auto ok = ReadList(*root, "objects", kMostObjects, scene, ReadObject); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = ReadList(*root, "lights", kMostLights, scene, ReadLight); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = ReadAmbient(*root, scene); !ok) return tl::unexpected(ok.error());
  if (auto ok = ReadList(*root, "reflectors", kMostReflectors, scene, ReadReflector); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = ReadList(*root, "reactions", kMostReactions, scene, ReadReaction); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = ReadAvatar(*root, scene); !ok) return tl::unexpected(ok.error());
  if (auto ok = root->CheckAllKnown(); !ok) return tl::unexpected(ok.error());
  return scene;
}

}  // namespace

Result<SceneDescription> ParseScene(const std::string& text, const std::string& place) {
  try {
    return Parse(text, place);
  } catch (const std::exception& e) {  // yaml-cpp throws on access too
    return Fail(ErrorCode::kInvalidConfig, place + ": cannot be read as YAML (" + e.what() + ")");
  }
}

}  // namespace mixstage
