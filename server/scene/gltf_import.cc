// SPDX-License-Identifier: Apache-2.0
//
// glTF 2.0 by tinygltf, between a gate in front (gltf_gate.h) and bounds checks behind (gltf_accessor.h).
#include <tiny_gltf.h>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "proto/link/fixed_text.h"
#include "server/scene/gltf_accessor.h"
#include "server/scene/gltf_gate.h"
#include "server/scene/gltf_material.h"
#include "server/scene/model_file.h"

namespace mixstage {
namespace {

auto Bad(const std::string& what) { return Fail(ErrorCode::kBadInput, what); }

// Nodes may draw a mesh many times, and primitives share vertices: bounds the time that takes, not the
// memory.
constexpr std::size_t kReadVertices = 20 * ModelLimits::kVertices;
constexpr std::size_t kMostName = 64;  // of an animation

// What tinygltf asks of the world while it parses: files of the model's folder within a budget, and pictures,
// which are only kept (decoding waits until a material uses one).
struct Source {
  std::filesystem::path folder;
  std::size_t bytes_left = ModelLimits::kTotalBytes;
  std::string refusal;  // why the first file was refused
  std::vector<std::vector<std::uint8_t>> images;

  Result<std::filesystem::path> Resolve(const std::string& path) {
    const std::string prefix = folder.string() + "/";
    if (path.rfind(prefix, 0) != 0) return Fail(ErrorCode::kBadInput, "is outside the model's folder");
    auto found = ResolveInside(folder, path.substr(prefix.size()));
    if (!found && refusal.empty()) refusal = found.error().message;
    return found;
  }
};

bool FileExists(const std::string& path, void* user) {
  return static_cast<Source*>(user)->Resolve(path).has_value();
}
std::string SamePath(const std::string& path, void* /*user*/) { return path; }
bool ReadFile(std::vector<unsigned char>* out, std::string* error, const std::string& path, void* user) {
  auto& source = *static_cast<Source*>(user);
  auto file = source.Resolve(path);
  auto bytes = file ? ReadFileBytes(*file, std::min(source.bytes_left, ModelLimits::kFileBytes))
                    : Result<std::vector<std::uint8_t>>(tl::unexpected(file.error()));
  if (!bytes) {
    if (error != nullptr) *error += bytes.error().message;
    return false;
  }
  source.bytes_left -= bytes->size();
  *out = std::move(*bytes);
  return true;
}
bool WriteFile(std::string* /*error*/, const std::string& /*path*/,
               const std::vector<unsigned char>& /*bytes*/, void* /*user*/) {
  return false;
}

bool KeepImage(tinygltf::Image* image, int index, std::string* /*error*/, std::string* /*warning*/,
               int /*width*/, int /*height*/, const unsigned char* bytes, int size, void* user) {
  auto& source = *static_cast<Source*>(user);
  // Pointer and size of a buffer view come unchecked: GltfViewBytes fetches those later.
  if (image->bufferView >= 0 || index < 0 || size <= 0) return true;
  const auto i = static_cast<std::size_t>(index);
  if (source.images.size() <= i) source.images.resize(i + 1);
  source.images[i].assign(bytes, bytes + size);
  return true;
}

// tinygltf reports several lines: the first says it.
std::string FirstLine(const std::string& text) {
  const std::string line = text.substr(0, text.find('\n'));
  return line.empty() ? "is no valid glTF" : line.substr(0, 200);
}

Result<Eigen::Affine3d> LocalTransform(const tinygltf::Node& node, const std::string& place) {
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  if (node.matrix.size() == 16) {
    T.matrix() = Eigen::Map<const Eigen::Matrix4d>(node.matrix.data());  // column-major in glTF, as in Eigen
    if ((T.matrix().row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-6) {
      return Bad(place + ".matrix is not affine");
    }
  } else {
    if (node.translation.size() == 3) T.translate(Eigen::Map<const Eigen::Vector3d>(node.translation.data()));
    if (node.rotation.size() == 4) {
      Eigen::Quaterniond q(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]);
      if (!(q.norm() > 1e-6)) return Bad(place + ".rotation is no rotation");
      T.rotate(q.normalized());
    }
    if (node.scale.size() == 3)
      T.scale(Eigen::Vector3d(Eigen::Map<const Eigen::Vector3d>(node.scale.data())));
  }
  if (!T.matrix().allFinite()) return Bad(place + " has a transform that is not finite");
  return T;
}

// A strip's or fan's triangles, each wound like the list's.
std::vector<std::uint32_t> AsTriangles(std::vector<std::uint32_t> in, int mode) {
  if (mode == TINYGLTF_MODE_TRIANGLES || mode < 0) {
    in.resize(in.size() / 3 * 3);
    return in;
  }
  std::vector<std::uint32_t> out;
  for (std::size_t i = 2; i < in.size(); ++i) {
    if (mode == TINYGLTF_MODE_TRIANGLE_FAN) {
      out.insert(out.end(), {in[0], in[i - 1], in[i]});
    } else {
      const std::size_t odd = i % 2;
      out.insert(out.end(), {in[i - 2 + odd], in[i - 1 - odd], in[i]});
    }
  }
  return out;
}

class Importer {
 public:
  Importer(const tinygltf::Model& model, GltfMaterials materials, LoadedModel& out)
      : model_(model), transforms_(std::move(materials.transforms)), out_(out) {
    out_.mesh.materials = std::move(materials.materials);
    out_.mesh.textures = std::move(materials.textures);
  }

  Status AddScene() {
    struct Entry {
      int node;
      Eigen::Affine3d T_model_parent;
      std::int32_t parent;  // of motion_.nodes
    };
    std::vector<Entry> open;
    for (const int root : Roots()) open.push_back({root, Eigen::Affine3d::Identity(), -1});
    motion_node_.assign(model_.nodes.size(), -1);
    while (!open.empty()) {
      const Entry entry = open.back();
      open.pop_back();
      const std::string place = "nodes[" + std::to_string(entry.node) + "]";
      if (entry.node < 0 || static_cast<std::size_t>(entry.node) >= model_.nodes.size()) {
        return Bad(place + " does not exist");
      }
      // glTF's nodes are strict trees; in anything else a walk may never end.
      std::int32_t& here = motion_node_[static_cast<std::size_t>(entry.node)];
      if (here >= 0) return Bad(place + " has two parents or is its own child");
      here = static_cast<std::int32_t>(motion_.nodes.size());
      const tinygltf::Node& node = model_.nodes[static_cast<std::size_t>(entry.node)];
      auto T_parent_node = LocalTransform(node, place);
      if (!T_parent_node) return tl::unexpected(T_parent_node.error());
      const Eigen::Affine3d T_model_node = entry.T_model_parent * *T_parent_node;
      motion_.nodes.push_back(MotionNodeOf(node, *T_parent_node, entry.parent));
      if (node.mesh >= 0) {
        // By the specification the node of a skinned mesh does not move it, its joints do.
        const bool skinned = node.skin >= 0;
        if (auto bones = skinned ? BonesOfSkin(node.skin) : RigidBone(here); bones) {
          bones_ = *bones;
        } else {
          return tl::unexpected(bones.error());
        }
        if (auto ok = AddMesh(node.mesh, skinned ? Eigen::Affine3d::Identity() : T_model_node); !ok)
          return ok;
      }
      for (const int child : node.children) open.push_back({child, T_model_node, here});
    }
    if (auto ok = Move(); !ok) return ok;
    if (morphed_) out_.warnings.emplace_back("its morph targets are not drawn");
    if (other_modes_) out_.warnings.emplace_back("its points and lines are not drawn");
    return {};
  }

 private:
  std::vector<int> Roots() const {
    if (!model_.scenes.empty()) {
      const int scene = model_.defaultScene;
      const bool valid = scene >= 0 && static_cast<std::size_t>(scene) < model_.scenes.size();
      return model_.scenes[valid ? static_cast<std::size_t>(scene) : 0].nodes;
    }
    std::vector<char> is_child(model_.nodes.size(), 0);
    for (const tinygltf::Node& node : model_.nodes) {
      for (const int child : node.children) {
        if (child >= 0 && static_cast<std::size_t>(child) < is_child.size())
          is_child[static_cast<std::size_t>(child)] = 1;
      }
    }
    std::vector<int> roots;
    for (std::size_t i = 0; i < is_child.size(); ++i) {
      if (is_child[i] == 0) roots.push_back(static_cast<int>(i));
    }
    return roots;
  }

  Status AddMesh(int index, const Eigen::Affine3d& T_model_mesh) {
    const std::string place = "meshes[" + std::to_string(index) + "]";
    if (static_cast<std::size_t>(index) >= model_.meshes.size()) return Bad(place + " does not exist");
    const std::vector<tinygltf::Primitive>& primitives =
        model_.meshes[static_cast<std::size_t>(index)].primitives;
    for (std::size_t i = 0; i < primitives.size(); ++i) {
      if (auto ok = AddPrimitive(primitives[i], T_model_mesh); !ok) {
        return Within(place + ".primitives[" + std::to_string(i) + "]", ok.error());
      }
    }
    return {};
  }

  Status AddPrimitive(const tinygltf::Primitive& primitive, const Eigen::Affine3d& T_model_mesh) {
    if (++primitives_ > ModelLimits::kParts) return Bad("takes the model over the limit of parts");
    morphed_ |= !primitive.targets.empty();
    const auto position = primitive.attributes.find("POSITION");
    const bool triangles = primitive.mode < 0 || (primitive.mode >= TINYGLTF_MODE_TRIANGLES &&
                                                  primitive.mode <= TINYGLTF_MODE_TRIANGLE_FAN);
    if (!triangles || position == primitive.attributes.end()) {
      other_modes_ = true;
      return {};
    }
    Mesh piece;
    if (auto ok = ReadAttributes(primitive, position->second, piece); !ok) return ok;
    read_vertices_ += piece.positions.size();
    if (read_vertices_ > kReadVertices)
      return Bad("reads over 100 million vertices, the same again and again");
    std::vector<std::uint32_t> indices(piece.positions.size());
    std::iota(indices.begin(), indices.end(), 0u);
    if (primitive.indices >= 0) {
      auto read = ReadGltfIndices(model_, primitive.indices, piece.positions.size());
      if (!read) return Within("indices", read.error());
      indices = std::move(*read);
    }
    piece.indices = AsTriangles(std::move(indices), primitive.mode);
    if (piece.indices.empty()) return {};
    if (piece.triangle_count() + out_.mesh.triangle_count() > ModelLimits::kTriangles)
      return Bad("takes the model over the limit of triangles");
    auto hung = BonesOfVertices(primitive, piece.positions.size());
    if (!hung) return tl::unexpected(hung.error());
    if (piece.normals.empty()) {
      // Every triangle gets vertices of its own.
      std::vector<VertexBones> own;
      for (const std::uint32_t i : piece.indices) own.push_back((*hung)[i]);
      *hung = std::move(own);
      FlatNormals(piece);
    }
    if (piece.positions.size() + out_.mesh.positions.size() > ModelLimits::kVertices)
      return Bad("takes the model over the limit of vertices");
    piece.parts.push_back({0, static_cast<std::uint32_t>(piece.indices.size()), MaterialOf(primitive)});
    motion_.vertices.insert(motion_.vertices.end(), hung->begin(), hung->end());
    motion_.bind_positions.insert(motion_.bind_positions.end(), piece.positions.begin(),
                                  piece.positions.end());
    motion_.bind_normals.insert(motion_.bind_normals.end(), piece.normals.begin(), piece.normals.end());
    Place(piece, T_model_mesh);
    AppendTriangles(out_.mesh, std::move(piece));
    return {};
  }

  int MaterialOf(const tinygltf::Primitive& primitive) const {
    const int standard = static_cast<int>(out_.mesh.materials.size()) - 1;
    return primitive.material >= 0 && primitive.material < standard ? primitive.material : standard;
  }

  Status ReadAttributes(const tinygltf::Primitive& primitive, int position, Mesh& piece) const {
    auto positions = ReadGltfNumbers(model_, position, {3});
    if (!positions) return Within("POSITION", positions.error());
    const std::size_t n = positions->count();
    for (std::size_t i = 0; i < n; ++i) piece.positions.emplace_back(positions->values.data() + 3 * i);
    auto read = [&](const std::string& name, std::initializer_list<int> components, auto&& take) -> Status {
      const auto found = primitive.attributes.find(name);
      if (found == primitive.attributes.end()) return {};
      auto numbers = ReadGltfNumbers(model_, found->second, components);
      if (!numbers) return Within(name, numbers.error());
      if (numbers->count() != n) return Bad(name + " has not as many entries as POSITION");
      for (std::size_t i = 0; i < n; ++i)
        take(numbers->values.data() + i * static_cast<std::size_t>(numbers->components));
      return {};
    };
    const TextureTransform& transform = transforms_[static_cast<std::size_t>(MaterialOf(primitive))];
    auto ok = read("NORMAL", {3}, [&](const float* v) { piece.normals.emplace_back(v); });
    if (ok) {
      ok = read("TEXCOORD_" + std::to_string(transform.uv_set), {2},
                [&](const float* v) { piece.uvs.push_back(transform.Apply(Eigen::Vector2f(v))); });
    }
    if (ok) {
      ok = read("COLOR_0", {3, 4}, [&](const float* v) {
        piece.colors.push_back(Eigen::Vector3f(v).cwiseMax(0.0f).cwiseMin(1.0f));
      });
    }
    return ok;
  }

  // What vertices of the mesh that is read now may hang on.
  struct Bones {
    std::size_t first = 0, count = 0;
    bool skin = false;
  };

  static MotionNode MotionNodeOf(const tinygltf::Node& node, const Eigen::Affine3d& T_parent_node,
                                 std::int32_t parent) {
    MotionNode out;
    out.parent = parent;
    out.T_parent_node = RowsOf(T_parent_node);
    const auto copy = [](const std::vector<double>& from, auto& to) {
      if (from.size() == to.size())
        std::transform(from.begin(), from.end(), to.begin(), [](double v) { return static_cast<float>(v); });
    };
    copy(node.translation, out.translation);
    copy(node.rotation, out.rotation);
    copy(node.scale, out.scale);
    return out;
  }

  static AffineRows RowsOf(const Eigen::Affine3d& T) {
    AffineRows rows;
    Eigen::Map<Eigen::Matrix<float, 3, 4, Eigen::RowMajor>>(rows.data()) =
        T.matrix().topRows<3>().cast<float>();
    return rows;
  }

  Result<Bones> RigidBone(std::int32_t node) {
    motion_.bones.push_back({.node = node});
    return Bones{motion_.bones.size() - 1, 1, false};
  }

  // Joints may come later in the tree: until Move() a bone's node is glTF's.
  Result<Bones> BonesOfSkin(int index) {
    skinned_ = true;
    const std::string place = "skins[" + std::to_string(index) + "]";
    if (static_cast<std::size_t>(index) >= model_.skins.size()) return Bad(place + " does not exist");
    const auto known = bones_of_skin_.find(index);
    if (known != bones_of_skin_.end()) return known->second;
    const tinygltf::Skin& skin = model_.skins[static_cast<std::size_t>(index)];
    if (skin.joints.empty()) return Bad(place + " has no joints");
    std::vector<float> inverse_bind;
    if (skin.inverseBindMatrices >= 0) {
      auto read = ReadGltfNumbers(model_, skin.inverseBindMatrices, {16});
      if (!read) return Within(place + ".inverseBindMatrices", read.error());
      if (read->count() < skin.joints.size())
        return Bad(place + ".inverseBindMatrices has fewer entries than joints");
      inverse_bind = std::move(read->values);
    }
    const Bones bones{motion_.bones.size(), skin.joints.size(), true};
    for (std::size_t i = 0; i < skin.joints.size(); ++i) {
      const int joint = skin.joints[i];
      if (joint < 0 || static_cast<std::size_t>(joint) >= model_.nodes.size())
        return Bad(place + " names a joint that does not exist");
      MotionBone bone{.node = joint};
      if (!inverse_bind.empty()) {
        Eigen::Affine3d T = Eigen::Affine3d::Identity();
        T.matrix() = Eigen::Map<const Eigen::Matrix4f>(inverse_bind.data() + 16 * i).cast<double>();
        bone.T_node_bind = RowsOf(T);
      }
      joints_.push_back(motion_.bones.size());
      motion_.bones.push_back(bone);
    }
    if (motion_.bones.size() > MeshMotion::kMostBones)
      return Bad(place + " takes the model over the limit of bones");
    bones_of_skin_[index] = bones;
    return bones;
  }

  Result<std::vector<VertexBones>> BonesOfVertices(const tinygltf::Primitive& primitive,
                                                   std::size_t count) const {
    VertexBones whole;
    whole.bone.fill(static_cast<std::uint16_t>(bones_.first));
    std::vector<VertexBones> hung(count, whole);
    const auto joints = primitive.attributes.find("JOINTS_0");
    const auto weights = primitive.attributes.find("WEIGHTS_0");
    if (!bones_.skin || joints == primitive.attributes.end() || weights == primitive.attributes.end())
      return hung;
    auto joint = ReadGltfNumbers(model_, joints->second, {4});
    if (!joint) return Within("JOINTS_0", joint.error());
    auto weight = ReadGltfNumbers(model_, weights->second, {4});
    if (!weight) return Within("WEIGHTS_0", weight.error());
    if (joint->count() != count || weight->count() != count)
      return Bad("JOINTS_0 or WEIGHTS_0 has not as many entries as POSITION");
    for (std::size_t i = 0; i < count; ++i) {
      VertexBones& on = hung[i];
      float sum = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        const float number = joint->values[4 * i + k];
        const float share = std::max(0.0f, weight->values[4 * i + k]);
        if (!(number >= 0 && number < static_cast<float>(bones_.count)))
          return Bad("JOINTS_0 names a joint that the skin does not have");
        on.bone[k] = static_cast<std::uint16_t>(bones_.first + static_cast<std::size_t>(number));
        on.weight[k] = share;
        sum += share;
      }
      for (float& share : on.weight) share = sum > 0 ? share / sum : 0;
      if (!(sum > 0)) on.weight[0] = 1;
    }
    return hung;
  }

  // Reads the animations; the mesh becomes what it is as the first begins.
  Status Move() {
    for (const std::size_t i : joints_) {
      std::int32_t& node = motion_.bones[i].node;
      node = motion_node_[static_cast<std::size_t>(node)];
      if (node < 0) return Bad("a skin names a joint that is not in the scene");
    }
    for (std::size_t i = 0; i < model_.animations.size(); ++i) {
      if (auto ok = AddClip(model_.animations[i]); !ok)
        return Within("animations[" + std::to_string(i) + "]", ok.error());
    }
    if ((motion_.clips.empty() && !skinned_) || out_.mesh.positions.empty()) return {};
    if (auto ok = CheckMotion(motion_, out_.mesh.positions.size()); !ok) return ok;
    PosedVertices posed = PoseMesh(motion_, motion_.clips.empty() ? -1 : 0, 0);
    out_.mesh.positions = std::move(posed.positions);
    out_.mesh.normals = std::move(posed.normals);
    if (!motion_.clips.empty()) out_.mesh.motion = std::make_shared<const MeshMotion>(std::move(motion_));
    return {};
  }

  Status AddClip(const tinygltf::Animation& animation) {
    MotionClip clip;
    for (std::size_t i = 0; i < animation.channels.size(); ++i) {
      const tinygltf::AnimationChannel& channel = animation.channels[i];
      const std::string place = "channels[" + std::to_string(i) + "]";
      if (channel.target_path == "weights") {
        morphed_ = true;
        continue;
      }
      if (channel.target_node < 0 || static_cast<std::size_t>(channel.target_node) >= motion_node_.size() ||
          motion_node_[static_cast<std::size_t>(channel.target_node)] < 0)
        continue;  // of another scene
      if (channel.sampler < 0 || static_cast<std::size_t>(channel.sampler) >= animation.samplers.size())
        return Bad(place + ".sampler does not exist");
      auto track =
          ReadTrack(animation.samplers[static_cast<std::size_t>(channel.sampler)], channel.target_path);
      if (!track) return Within(place, track.error());
      track->node = motion_node_[static_cast<std::size_t>(channel.target_node)];
      if (!track->times_s.empty()) clip.duration_s = std::max(clip.duration_s, track->times_s.back());
      clip.tracks.push_back(std::move(*track));
    }
    if (clip.tracks.empty() || motion_.clips.size() == MeshMotion::kMostClips) return {};
    clip.name = Fitting(animation.name, kMostName);
    for (std::size_t number = motion_.clips.size(); clip.name.empty() || FindClip(motion_, clip.name);
         ++number)
      clip.name = std::to_string(number);
    motion_.clips.push_back(std::move(clip));
    return {};
  }

  Result<MotionTrack> ReadTrack(const tinygltf::AnimationSampler& sampler, const std::string& path) const {
    MotionTrack track;
    if (path == "rotation") {
      track.path = MotionPath::kRotation;
    } else if (path == "scale") {
      track.path = MotionPath::kScale;
    } else if (path != "translation") {
      return Bad("target.path is none of translation, rotation, scale, weights");
    }
    if (sampler.interpolation == "STEP") track.step = MotionStep::kStep;
    if (sampler.interpolation == "CUBICSPLINE") track.step = MotionStep::kCubic;
    auto times = ReadGltfNumbers(model_, sampler.input, {1});
    if (!times) return Within("input", times.error());
    auto values = ReadGltfNumbers(model_, sampler.output, {path == "rotation" ? 4 : 3});
    if (!values) return Within("output", values.error());
    track.times_s = std::move(times->values);
    track.values = std::move(values->values);
    numbers_ += track.times_s.size() + track.values.size();
    if (numbers_ > MeshMotion::kMostNumbers) return Bad("takes the model over the limit of animated numbers");
    return track;
  }

  // Into the model's coordinates; a mirroring transform turns the triangles' winding, which is turned back.
  static void Place(Mesh& piece, const Eigen::Affine3d& T) {
    const Eigen::Matrix3d linear = T.linear();
    // The cofactor matrix is det(A) A^-T: it maps normals also where a scale is 0.
    Eigen::Matrix3d cofactor;
    cofactor.row(0) = linear.row(1).cross(linear.row(2));
    cofactor.row(1) = linear.row(2).cross(linear.row(0));
    cofactor.row(2) = linear.row(0).cross(linear.row(1));
    const bool mirrors = linear.determinant() < 0;
    if (mirrors) cofactor = -cofactor;
    for (Eigen::Vector3f& p : piece.positions) p = (T * p.cast<double>()).cast<float>();
    for (Eigen::Vector3f& n : piece.normals) {
      const Eigen::Vector3d mapped = cofactor * n.cast<double>();
      const double length = mapped.norm();
      n = std::isfinite(length) && length > 0 ? Eigen::Vector3f((mapped / length).cast<float>())
                                              : Eigen::Vector3f::UnitY();
    }
    if (!mirrors) return;
    for (std::size_t t = 0; t + 2 < piece.indices.size(); t += 3)
      std::swap(piece.indices[t + 1], piece.indices[t + 2]);
  }

  const tinygltf::Model& model_;
  const std::vector<TextureTransform> transforms_;
  LoadedModel& out_;
  std::size_t primitives_ = 0,
              read_vertices_ = 0;  // every time a node draws them, also what leaves no triangle
  bool skinned_ = false, morphed_ = false, other_modes_ = false;
  MeshMotion motion_;
  std::vector<std::int32_t> motion_node_;  // by glTF's index; -1: not in the scene
  std::vector<std::size_t> joints_;        // bones that are a skin's
  std::map<int, Bones> bones_of_skin_;
  Bones bones_;
  mutable std::size_t numbers_ = 0;  // of all tracks
};

}  // namespace

Result<LoadedModel> ImportGltf(const std::vector<std::uint8_t>& bytes, const std::filesystem::path& folder) {
  auto container = CheckGltf(bytes);
  if (!container) return tl::unexpected(container.error());
  std::error_code error;
  Source source;
  source.folder = std::filesystem::canonical(folder.empty() ? std::filesystem::path(".") : folder, error);
  if (error) return Bad("its folder cannot be read");
  tinygltf::TinyGLTF parser;
  parser.SetFsCallbacks({&FileExists, &SamePath, &ReadFile, &WriteFile, &source});
  parser.SetImageLoader(&KeepImage, &source);
  tinygltf::Model model;
  std::string errors;
  std::string warnings;
  const auto size = static_cast<unsigned int>(bytes.size());
  const bool parsed = *container == GltfContainer::kBinary
                          ? parser.LoadBinaryFromMemory(&model, &errors, &warnings, bytes.data(), size,
                                                        source.folder.string())
                          : parser.LoadASCIIFromString(&model, &errors, &warnings,
                                                       reinterpret_cast<const char*>(bytes.data()), size,
                                                       source.folder.string());
  if (!parsed) return Bad(source.refusal.empty() ? FirstLine(errors) : source.refusal);
  LoadedModel out;
  out.up = UpAxis::kY;
  GltfMaterials materials = ReadGltfMaterials(model, source.images, out.warnings);
  Importer importer(model, std::move(materials), out);
  if (auto ok = importer.AddScene(); !ok) return tl::unexpected(ok.error());
  return out;
}

}  // namespace mixstage
