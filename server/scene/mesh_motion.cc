// SPDX-License-Identifier: Apache-2.0
#include "server/scene/mesh_motion.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "proto/base/check.h"

namespace mixstage {
namespace {

using Rows = Eigen::Map<const Eigen::Matrix<float, 3, 4, Eigen::RowMajor>>;
using Affine = Eigen::Matrix<float, 3, 4>;

constexpr float kFarthest = 1e6f;

Affine Times(const Affine& a, const Affine& b) {
  Affine out;
  out.leftCols<3>() = a.leftCols<3>() * b.leftCols<3>();
  out.col(3) = a.leftCols<3>() * b.col(3) + a.col(3);
  return out;
}

// det(A) A^-T, turned so that it keeps the outside outside: it maps normals, also where A is singular.
Eigen::Matrix3f NormalMatrix(const Eigen::Matrix3f& A) {
  Eigen::Matrix3f cofactor;
  cofactor.row(0) = A.row(1).cross(A.row(2));
  cofactor.row(1) = A.row(2).cross(A.row(0));
  cofactor.row(2) = A.row(0).cross(A.row(1));
  return A.determinant() < 0 ? Eigen::Matrix3f(-cofactor) : cofactor;
}

std::size_t Numbers(MotionPath path) { return path == MotionPath::kRotation ? 4 : 3; }

Eigen::Quaternionf Turn(const Eigen::Vector4f& xyzw) {
  Eigen::Quaternionf q(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
  const float length = q.norm();
  return std::isfinite(length) && length > 1e-6f ? q.normalized() : Eigen::Quaternionf::Identity();
}

// The value of a track; the fourth number of what has three is 0.
Eigen::Vector4f ValueAt(const MotionTrack& track, float t_s) {
  const std::size_t numbers = Numbers(track.path);
  const std::size_t a_key = numbers * (track.step == MotionStep::kCubic ? 3 : 1);
  const auto at = [&](std::size_t key, std::size_t part) {
    Eigen::Vector4f value = Eigen::Vector4f::Zero();
    for (std::size_t k = 0; k < numbers; ++k)
      value[static_cast<Eigen::Index>(k)] = track.values[key * a_key + part * numbers + k];
    return value;
  };
  const std::size_t value_part = track.step == MotionStep::kCubic ? 1 : 0;
  const auto next = std::ranges::upper_bound(track.times_s, t_s);
  if (next == track.times_s.begin()) return at(0, value_part);
  const auto key = static_cast<std::size_t>(next - track.times_s.begin()) - 1;
  if (next == track.times_s.end() || track.step == MotionStep::kStep) return at(key, value_part);
  const float span = track.times_s[key + 1] - track.times_s[key];
  const float u = (t_s - track.times_s[key]) / span;
  const Eigen::Vector4f a = at(key, value_part);
  const Eigen::Vector4f b = at(key + 1, value_part);
  if (track.step == MotionStep::kCubic) {  // Hermite's, its tangents a second
    const float u2 = u * u, u3 = u2 * u;
    return (2 * u3 - 3 * u2 + 1) * a + (u3 - 2 * u2 + u) * span * at(key, 2) + (3 * u2 - 2 * u3) * b +
           (u3 - u2) * span * at(key + 1, 0);
  }
  if (track.path != MotionPath::kRotation) return a + u * (b - a);
  return Turn(a).slerp(u, Turn(b)).coeffs();
}

Affine LocalTransform(const Eigen::Vector3f& translation, const Eigen::Quaternionf& rotation,
                      const Eigen::Vector3f& scale) {
  Affine T;
  T.leftCols<3>() = rotation.toRotationMatrix() * scale.asDiagonal();
  T.col(3) = translation;
  return T;
}

// T_model_node of every node.
std::vector<Affine> PlaceNodes(const MeshMotion& motion, const MotionClip* clip, float t_s) {
  struct Moved {
    Eigen::Vector3f translation, scale;
    Eigen::Quaternionf rotation;
    bool any = false;
  };
  std::vector<Moved> moved(motion.nodes.size());
  for (std::size_t i = 0; clip != nullptr && i < clip->tracks.size(); ++i) {
    const MotionTrack& track = clip->tracks[i];
    const auto node = static_cast<std::size_t>(track.node);
    Moved& to = moved[node];
    if (!to.any) {
      const MotionNode& rest = motion.nodes[node];
      to = {Eigen::Vector3f(rest.translation.data()), Eigen::Vector3f(rest.scale.data()),
            Turn(Eigen::Vector4f(rest.rotation.data())), true};
    }
    const Eigen::Vector4f value = ValueAt(track, t_s);
    switch (track.path) {
      case MotionPath::kTranslation:
        to.translation = value.head<3>();
        break;
      case MotionPath::kRotation:
        to.rotation = Turn(value);
        break;
      case MotionPath::kScale:
        to.scale = value.head<3>();
        break;
    }
  }
  std::vector<Affine> placed(motion.nodes.size());
  for (std::size_t i = 0; i < placed.size(); ++i) {
    const MotionNode& node = motion.nodes[i];
    const Affine T = moved[i].any ? LocalTransform(moved[i].translation, moved[i].rotation, moved[i].scale)
                                  : Affine(Rows(node.T_parent_node.data()));
    placed[i] = node.parent < 0 ? T : Times(placed[static_cast<std::size_t>(node.parent)], T);
  }
  return placed;
}

template <typename Values>
bool AllFinite(const Values& values) {
  return std::ranges::all_of(values, [](float v) { return std::isfinite(v); });
}

// Empty: all is well.
std::string WrongInTrack(const MotionTrack& track, std::size_t nodes) {
  if (track.node < 0 || static_cast<std::size_t>(track.node) >= nodes)
    return "moves a node that is not there";
  if (track.times_s.empty()) return "has no keys";
  if (track.path < MotionPath::kTranslation || track.path > MotionPath::kScale ||
      track.step < MotionStep::kStep || track.step > MotionStep::kCubic)
    return "is of no known kind";
  if (track.values.size() !=
      track.times_s.size() * Numbers(track.path) * (track.step == MotionStep::kCubic ? 3 : 1))
    return "has not one value a key";
  if (!AllFinite(track.times_s) || !AllFinite(track.values)) return "holds a number that is not finite";
  if (track.times_s.front() < 0 ||
      std::ranges::adjacent_find(track.times_s, std::greater_equal<>()) != track.times_s.end())
    return "has times that do not rise from 0 on";
  return "";
}

}  // namespace

Status CheckMotion(const MeshMotion& motion, std::size_t vertices) {
  const auto bad = [](const std::string& what) { return Fail(ErrorCode::kBadInput, what); };
  if (motion.nodes.size() > MeshMotion::kMostNodes || motion.bones.size() > MeshMotion::kMostBones ||
      motion.clips.size() > MeshMotion::kMostClips)
    return bad("has more nodes, bones or animations than can be moved");
  for (std::size_t i = 0; i < motion.nodes.size(); ++i) {
    const MotionNode& node = motion.nodes[i];
    if (node.parent < -1 || node.parent >= static_cast<std::int32_t>(i))
      return bad("has a node before its parent");
    if (!AllFinite(node.T_parent_node) || !AllFinite(node.translation) || !AllFinite(node.rotation) ||
        !AllFinite(node.scale))
      return bad("has a node whose transform is not finite");
  }
  for (const MotionBone& bone : motion.bones) {
    if (bone.node < 0 || static_cast<std::size_t>(bone.node) >= motion.nodes.size())
      return bad("has a bone without its node");
    if (!AllFinite(bone.T_node_bind)) return bad("has a bind matrix that is not finite");
  }
  if (motion.vertices.size() != vertices || motion.bind_positions.size() != vertices ||
      motion.bind_normals.size() != vertices)
    return bad("has not one place a vertex to move");
  for (std::size_t i = 0; i < vertices; ++i) {
    float sum = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const float weight = motion.vertices[i].weight[k];
      if (!(weight >= 0 && weight <= 1.001f) || motion.vertices[i].bone[k] >= motion.bones.size())
        return bad("has a vertex that hangs on no bone");
      sum += weight;
    }
    if (!(std::abs(sum - 1) < 1e-3f) || !motion.bind_positions[i].allFinite() ||
        !motion.bind_normals[i].allFinite())
      return bad("has a vertex whose weights are not together 1");
  }
  std::size_t tracks = 0, numbers = 0;
  for (const MotionClip& clip : motion.clips) {
    if (clip.name.empty() || FindClip(motion, clip.name) != static_cast<int>(&clip - motion.clips.data()))
      return bad("has an animation without a name of its own");
    if (!(clip.duration_s >= 0) || !std::isfinite(clip.duration_s))
      return bad("has an animation whose length is none");
    tracks += clip.tracks.size();
    for (const MotionTrack& track : clip.tracks) {
      numbers += track.times_s.size() + track.values.size();
      if (const std::string wrong = WrongInTrack(track, motion.nodes.size()); !wrong.empty())
        return bad("has an animation's track that " + wrong);
    }
  }
  if (tracks > MeshMotion::kMostTracks || numbers > MeshMotion::kMostNumbers)
    return bad("has animations of more than " + std::to_string(MeshMotion::kMostNumbers) + " numbers");
  return {};
}

std::optional<int> FindClip(const MeshMotion& motion, const std::string& name) {
  if (name == kNoClip) return -1;
  const auto found = std::ranges::find(motion.clips, name, &MotionClip::name);
  if (found == motion.clips.end()) return std::nullopt;
  return static_cast<int>(found - motion.clips.begin());
}

std::string ClipName(const MeshMotion& motion, int clip) {
  return clip < 0 ? kNoClip : motion.clips.at(static_cast<std::size_t>(clip)).name;
}

PosedVertices PoseMesh(const MeshMotion& motion, int clip, float t_s) {
  MIX_CHECK(clip < static_cast<int>(motion.clips.size()));
  const MotionClip* moving = clip < 0 ? nullptr : &motion.clips[static_cast<std::size_t>(clip)];
  const float t = moving == nullptr ? 0 : std::clamp(t_s, 0.0f, moving->duration_s);
  const std::vector<Affine> placed = PlaceNodes(motion, moving, t);
  std::vector<Affine> bones(motion.bones.size());
  std::vector<Eigen::Matrix3f> turns(bones.size());
  for (std::size_t i = 0; i < bones.size(); ++i) {
    const MotionBone& bone = motion.bones[i];
    bones[i] = Times(placed[static_cast<std::size_t>(bone.node)], Rows(bone.T_node_bind.data()));
    turns[i] = NormalMatrix(bones[i].leftCols<3>());
  }
  const std::size_t count = motion.vertices.size();
  PosedVertices posed;
  posed.positions.resize(count);
  posed.normals.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const VertexBones& on = motion.vertices[i];
    const Eigen::Vector3f& from = motion.bind_positions[i];
    const Eigen::Vector3f& facing = motion.bind_normals[i];
    Eigen::Vector3f p, n;
    if (on.weight[0] == 1) {  // a rigid part
      p = bones[on.bone[0]] * from.homogeneous();
      n = turns[on.bone[0]] * facing;
    } else {
      Affine T = on.weight[0] * bones[on.bone[0]];
      for (std::size_t k = 1; k < 4; ++k) {
        if (on.weight[k] > 0) T += on.weight[k] * bones[on.bone[k]];
      }
      p = T * from.homogeneous();
      n = NormalMatrix(T.leftCols<3>()) * facing;
    }
    posed.positions[i] = (p.array().abs() <= kFarthest).all() ? p : from;  // false of what is no number
    const float length = n.norm();
    posed.normals[i] = std::isfinite(length) && length > 0 ? Eigen::Vector3f(n / length) : facing;
  }
  return posed;
}

}  // namespace mixstage
