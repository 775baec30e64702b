// SPDX-License-Identifier: Apache-2.0
//
// The virtual part of the picture: objects placed in the room and the lights that shine on them (piVE section
// 4).
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/scene/avatar.h"
#include "server/scene/mesh.h"
#include "server/scene/mesh_motion.h"
#include "server/scene/placing.h"
#include "server/segmentation/left_behind.h"

namespace mixstage {

enum class SceneFrame {
  kWorld = 1,  // z up, floor at z = 0
  kCamera,     // the colour camera's at the first picture: x right, y down, z forward
};

// Who may touch an object (piVE section 4).
enum class Body {
  kIsolated = 1,
  kMutual,  // the other objects
  kActor,   // the actor too
};

struct SceneObject {
  std::uint32_t id = 0;              // from 1, unique in its scene and never used again while the server runs
  std::string name;                  // unique in its scene
  std::string file;                  // as the scene file names it
  std::shared_ptr<const Mesh> mesh;  // immutable; objects of one file share it
  int clip = 0;  // of mesh->motion, played again and again; -1: it stands as the first begins
  std::shared_ptr<const PosedVertices> posed{};  // instead of the mesh's own vertices; null: those
  Eigen::Affine3d T_scene_object = Eigen::Affine3d::Identity();  // file coordinates to the scene's frame
  // How T_scene_object was written, where it was written so: T_scene_object is exactly that.
  std::optional<Placing> placing;
  UpAxis usual_up = UpAxis::kY;  // of its kind of file
  Body body = Body::kMutual;
  bool drop = false;         // falls, rests and may be pushed: physics moves it from where it was put
  std::uint64_t put = 0;     // another number whenever a person has put it somewhere
  bool hidden = false;       // not drawn, not there to touch
  double mass_kg = 1.0;      // > 0
  double friction = 0.5;     // 0..2, against the room
  double restitution = 0.1;  // 0..1: speed after a bounce from the room over speed before

  // Where its vertices are now.
  [[nodiscard]] const std::vector<Eigen::Vector3f>& positions() const {
    return posed ? posed->positions : mesh->positions;
  }
  [[nodiscard]] const std::vector<Eigen::Vector3f>& normals() const {
    return posed ? posed->normals : mesh->normals;
  }
};

// An object that physics has moved.
struct MovedObject {
  std::uint32_t object = 0;
  std::uint64_t put = 0;  // as in the scene that physics moves it from
  Eigen::Affine3d T_scene_object = Eigen::Affine3d::Identity();
};

// Strengths are relative to the picture: 1.0 = the picture's white, linear light. A white (albedo 1) matt
// surface shows irradiance / pi.

// color x intensity: what a white surface shows that faces the light from 1 m away; falls with the square.
struct PointLight {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // scene frame
};
// color x intensity: what a white surface shows that faces the light.
struct DirectionalLight {
  Eigen::Vector3d toward_light = Eigen::Vector3d::UnitZ();  // unit vector, scene frame
};
// color x intensity: radiance of the rectangle's face, to the side of edge_u x edge_v.
struct AreaLight {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Vector3d edge_u = Eigen::Vector3d::Zero(), edge_v = Eigen::Vector3d::Zero();  // full sides
};

struct Light {
  std::uint32_t id = 0;  // > 0, unique among the scene's lights
  std::string name;
  std::variant<PointLight, DirectionalLight, AreaLight> shape;
  Eigen::Vector3f color = Eigen::Vector3f::Ones();  // linear, >= 0
  float intensity = 1.0f;                           // >= 0
  [[nodiscard]] Eigen::Vector3f Strength() const { return intensity * color; }
};

// What the room scatters: irradiance / pi on a white surface that faces up, and one that faces down; >= 0.
struct Ambient {
  float above = 0, below = 0;
  bool operator==(const Ambient&) const = default;
};

// A plane that mirrors (MixIn3D 3.3): a surface of the room, or with a color a patch that is not there in
// truth.
struct Reflector {
  std::string name;
  std::string
      surface;  // of the scanned room, by its plane's name: says plane and polygon; empty: they are given
  Eigen::Vector4d plane = Eigen::Vector4d::Zero();  // scene frame: n . x + d = 0, |n| = 1
  std::vector<Eigen::Vector3d> polygon;             // corners near the plane; empty: all of the plane
  std::optional<Eigen::Vector3f> color;             // of a patch, linear light; its polygon is convex
  double reflectivity = 0.04;                       // 0..1, seen head-on; 0 mirrors nothing
  double roughness = 0;                             // 0..1
};

// What follows when an object meets something.
struct SendMessage {
  std::string text;
  bool operator==(const SendMessage&) const = default;
};
struct DimLight {
  std::string light;
  float intensity = 0;  // from then on
  bool operator==(const DimLight&) const = default;
};
struct PutBack {
  std::string object;  // to where the scene has it, at rest
  bool operator==(const PutBack&) const = default;
};
struct PlayAnimation {
  std::string object, clip;  // once; see Animations
  bool operator==(const PlayAnimation&) const = default;
};
struct Reaction {
  std::string object, meets;  // as events name them (PhysicsEvent::name, with)
  double least_impulse_ns = 0;
  double after_s = 0;
  std::variant<SendMessage, DimLight, PutBack, PlayAnimation> action;
  bool operator==(const Reaction&) const = default;
};

struct Scene {
  SceneFrame frame = SceneFrame::kWorld;
  std::vector<SceneObject> objects;
  std::vector<Light> lights;       // empty: those of the environment, or the default light
  std::optional<Ambient> ambient;  // nothing: as usual with, or without, lights
  std::vector<Reflector> reflectors;
  std::vector<Reaction> reactions;
  std::optional<Avatar> avatar;  // nothing: the actor stays where he is. World scenes only
  // Things left behind that are the room's now, in the order of their commands; no part of scene.yaml.
  std::vector<std::shared_ptr<const AdoptedThing>> adopted;
  std::uint64_t revision =
      1;  // whoever changes the scene raises it; pictures drawn of an older one are stale
};

// The scene's patches as objects to be drawn, in the order of their reflectors; nobody touches them.
[[nodiscard]] std::vector<SceneObject> PatchObjects(const Scene& scene);

// "Up" of a frame as a unit vector.
[[nodiscard]] Eigen::Vector3d UpOf(SceneFrame frame);

}  // namespace mixstage
