// SPDX-License-Identifier: Apache-2.0
//
// What moves a mesh: the nodes, skins and animations of its file (glTF 2.0, 3.7.3 and 3.11).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

// Rows of a 3 x 4 matrix.
using AffineRows = std::array<float, 12>;
inline constexpr AffineRows kIdentityRows = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

struct MotionNode {
  std::int32_t parent = -1;                  // an earlier one; -1: none
  AffineRows T_parent_node = kIdentityRows;  // while nothing moves it
  // What that is made of; a track replaces a part of it.
  std::array<float, 3> translation = {0, 0, 0};
  std::array<float, 4> rotation = {0, 0, 0, 1};  // x y z w, of length 1
  std::array<float, 3> scale = {1, 1, 1};
};

// A vertex hangs on up to four of them.
struct MotionBone {
  std::int32_t node = 0;
  AffineRows T_node_bind = kIdentityRows;  // a skin's inverse bind matrix; a rigid part's identity
};
struct VertexBones {
  std::array<std::uint16_t, 4> bone = {0, 0, 0, 0};
  std::array<float, 4> weight = {1, 0, 0, 0};  // >= 0, together 1
};

enum class MotionPath : std::uint32_t { kTranslation = 1, kRotation, kScale };
enum class MotionStep : std::uint32_t { kStep = 1, kLinear, kCubic };  // between two keys

struct MotionTrack {
  std::int32_t node = 0;
  MotionPath path = MotionPath::kTranslation;
  MotionStep step = MotionStep::kLinear;
  std::vector<float> times_s;  // rising, from 0 on
  // 3 numbers a key, of a rotation 4; kCubic: tangent before, value, tangent after.
  std::vector<float> values;
};

inline constexpr const char* kNoClip = "none";

struct MotionClip {
  std::string name;      // neither empty nor kNoClip nor another clip's
  float duration_s = 0;  // of its last key; 0: a pose
  std::vector<MotionTrack> tracks;
};

struct MeshMotion {
  static constexpr std::size_t kMostNodes = 65'536, kMostBones = 65'536, kMostClips = 64;
  static constexpr std::size_t kMostTracks = 65'536;     // of all clips
  static constexpr std::size_t kMostNumbers = 8u << 20;  // times and values of all tracks

  std::vector<MotionNode> nodes;
  std::vector<MotionBone> bones;
  // One a vertex of the mesh: where it is in the coordinates that its bones are bound to.
  std::vector<VertexBones> vertices;
  std::vector<Eigen::Vector3f> bind_positions, bind_normals;
  std::vector<MotionClip> clips;
};

// Holds all of what the comments above promise, for a mesh of so many vertices; names what does not.
Status CheckMotion(const MeshMotion& motion, std::size_t vertices);

// A mesh's vertices at a moment of its motion.
struct PosedVertices {
  std::vector<Eigen::Vector3f> positions, normals;  // as many as the mesh has; normals have length 1
};

// t_s is clamped to 0 .. duration; clip < 0: as the nodes rest. What a clip blows up beyond 1e6 stays where
// it is bound.
[[nodiscard]] PosedVertices PoseMesh(const MeshMotion& motion, int clip, float t_s);

// The clip of that name, -1 for kNoClip; nothing where there is no such clip.
[[nodiscard]] std::optional<int> FindClip(const MeshMotion& motion, const std::string& name);
// The other way round.
[[nodiscard]] std::string ClipName(const MeshMotion& motion, int clip);

}  // namespace mixstage
