// SPDX-License-Identifier: Apache-2.0
//
// Text messages about the virtual scene (SPEC.md 4.5): what stands in it, edits of directors, and refusals.
// Reading checks type, size and finiteness of every field and names the one that is wrong; whether an edit
// makes sense (an object of that id, a place inside the room) is for the server's scene editor to say.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

inline constexpr std::size_t kMaxSceneObjects = 256;
inline constexpr std::size_t kMaxSceneLights = 64;
inline constexpr std::size_t kMaxSceneModels = 256;
inline constexpr std::size_t kMaxAnimations = 64;  // of an object

// ---- server to viewer ----
struct WatchObject {
  std::uint32_t id = 0;
  std::string name{}, file{};
  std::array<double, 16> pose{};  // T_scene_object, row-major
  std::string body{"mutual"};     // isolated, mutual, actor
  std::uint64_t triangles = 0;
  std::array<double, 6> bounds{};  // file coordinates: low x, y, z, high x, y, z
  std::array<double, 3> base{};    // scene frame: the middle of its lowest face
  double radius_m = 0;             // about base, at right angles to up
  bool hidden = false;
  std::vector<std::string> animations{};  // that its file has
  std::string animation{};                // the one it plays; where it has any: "none" = it stands
  bool operator==(const WatchObject&) const = default;
};

struct WatchLight {
  std::uint32_t id = 0;
  std::string name{};
  std::string kind{"point"};         // point, area, directional
  std::array<double, 3> position{};  // scene frame; directional: the unit vector toward the light
  std::array<double, 3> color{};
  double intensity = 0;
  bool operator==(const WatchLight&) const = default;
};

// The actor in another space: where the anchor of his floor lies in it, and how his world is turned.
struct WatchAvatar {
  std::array<double, 2> anchor{};    // his world
  std::array<double, 3> position{};  // scene frame
  double turn_deg = 0;               // about up
  bool operator==(const WatchAvatar&) const = default;
};

struct WatchScene {
  std::uint64_t revision = 0;
  std::string frame{"world"};  // world, camera
  std::array<double, 3> up{};  // unit vector of that frame
  bool can_undo = false, can_redo = false, unsaved = false;
  std::string by{};         // who changed it last; empty = nobody yet
  std::uint64_t edits = 0;  // accepted so far; what else changes is physics
  std::vector<WatchObject> objects{};
  std::vector<WatchLight> lights{};
  std::optional<WatchAvatar> avatar{};
  std::vector<std::string> models{};  // files that may be added
  std::uint64_t adopted = 0;          // things left behind that are the room's now
  bool operator==(const WatchScene&) const = default;
};

struct WatchRefused {
  int id = 0;  // of the edit, as its sender numbered it
  std::string reason{};
};

// ---- viewer to server: what an edit does ----
struct PicturePoint {
  double u = 0, v = 0;  // px of the colour picture
  bool operator==(const PicturePoint&) const = default;
};

struct AddObject {
  std::string file{};  // one of WatchScene::models
  PicturePoint at{};   // where on the room's surface it shall stand
  bool operator==(const AddObject&) const = default;
};

// Where a moved object's base goes:
struct ToSurface {
  PicturePoint at{};  // the room's surface under this pixel
  bool operator==(const ToSurface&) const = default;
};
struct AlongFloor {
  PicturePoint at{};  // where this pixel's ray meets the horizontal plane through the base
  bool operator==(const AlongFloor&) const = default;
};
struct ToPosition {
  std::array<double, 3> position{};  // scene frame
  bool operator==(const ToPosition&) const = default;
};
struct MoveObject {
  std::uint32_t object = 0;
  std::variant<ToSurface, AlongFloor, ToPosition> to{};
  bool operator==(const MoveObject&) const = default;
};

struct TurnObject {
  std::uint32_t object = 0;
  double angle_deg = 0;  // about up through its base, added
  bool operator==(const TurnObject&) const = default;
};
struct DropObject {
  std::uint32_t object = 0;
  bool operator==(const DropObject&) const = default;
};
struct DeleteObject {
  std::uint32_t object = 0;
  bool operator==(const DeleteObject&) const = default;
};
struct HideObject {
  std::uint32_t object = 0;
  bool hidden = false;
  bool operator==(const HideObject&) const = default;
};
struct AnimateObject {
  std::uint32_t object = 0;
  std::string animation{};  // of WatchObject::animations, or "none"
  bool operator==(const AnimateObject&) const = default;
};
struct ChangeLight {  // at least one of the three
  std::uint32_t light = 0;
  std::optional<std::array<double, 3>> position{}, color{};
  std::optional<double> intensity{};
  bool operator==(const ChangeLight&) const = default;
};
struct PlaceAvatar {  // at least one of the two
  std::optional<std::array<double, 3>> position{};
  std::optional<double> turn_deg{};
  bool operator==(const PlaceAvatar&) const = default;
};
struct AdoptThing {
  PicturePoint at{};  // what stands still there in the foreground is the room's from then on
  bool operator==(const AdoptThing&) const = default;
};
struct ForgetThings {  // all that was adopted
  bool operator==(const ForgetThings&) const = default;
};
struct UndoEdit {
  bool operator==(const UndoEdit&) const = default;
};
struct RedoEdit {
  bool operator==(const RedoEdit&) const = default;
};
struct SaveScene {
  bool operator==(const SaveScene&) const = default;
};

using EditOp =
    std::variant<AddObject, MoveObject, TurnObject, DropObject, DeleteObject, HideObject, AnimateObject,
                 ChangeLight, PlaceAvatar, AdoptThing, ForgetThings, UndoEdit, RedoEdit, SaveScene>;

struct WatchEdit {
  int id = 0;         // the sender's own number, >= 0
  bool live = false;  // in the middle of a drag: of move, turn, light and avatar only
  EditOp op{UndoEdit{}};
  bool operator==(const WatchEdit&) const = default;
};

// As on the wire: "add", "move", ...
[[nodiscard]] const char* OpName(const EditOp& op);

[[nodiscard]] std::string ToJson(const WatchScene& scene);
[[nodiscard]] std::string ToJson(const WatchRefused& refused);
[[nodiscard]] std::string ToJson(const WatchEdit& edit);

}  // namespace mixstage
