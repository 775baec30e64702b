// SPDX-License-Identifier: Apache-2.0
//
// A CG model as triangles: what every importer (glTF, OBJ, PLY) produces and what server/render draws.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "server/scene/mesh_motion.h"

namespace mixstage {

enum class TextureWrap {
  kRepeat = 1,
  kClamp,
  kMirror,
};

// One base colour picture: 8-bit sRGB, R G B A in memory order, A = coverage 0..255. Row 0 is v = 0 (glTF: v
// down).
struct Texture {
  cv::Mat4b rgba;  // at least 1 x 1
  TextureWrap wrap_u = TextureWrap::kRepeat, wrap_v = TextureWrap::kRepeat;
};

struct Material {
  std::string name;
  Eigen::Vector3f base_color =
      Eigen::Vector3f::Ones();              // linear light, multiplies texture and vertex colours
  float base_alpha = 1.0f;                  // 0..1, multiplies the texture's alpha
  int texture = -1;                         // into Mesh::textures; -1 = none
  float metallic = 0.0f, roughness = 0.8f;  // 0..1, as in glTF
  float head_on = 0.04f;                    // 0..1, what it mirrors where it is no metal: glass, paint, skin
  bool double_sided = true;                 // false: triangles seen from behind are not drawn
  bool alpha_mask = false;                  // a pixel below alpha_cutoff is not there
  float alpha_cutoff = 0.5f;
};

// Triangles of one material: indices[first_index .. first_index + index_count).
struct MeshPart {
  std::uint32_t first_index = 0;
  std::uint32_t index_count = 0;  // a multiple of 3
  int material = 0;               // into Mesh::materials, always valid
};

// In the file's own coordinates after its node transforms, as its first animation begins; right-handed,
// counter-clockwise = seen from outside. Held by every Mesh that an importer returns: all numbers finite,
// every index < positions.size(), normals of length 1 for every vertex, uvs and colors either empty or one a
// vertex, at least one triangle.
struct Mesh {
  std::vector<Eigen::Vector3f> positions;
  std::vector<Eigen::Vector3f> normals;
  std::vector<Eigen::Vector2f> uvs;     // v down
  std::vector<Eigen::Vector3f> colors;  // linear light 0..1
  std::vector<std::uint32_t> indices;
  std::vector<MeshPart> parts;
  std::vector<Material> materials;
  std::vector<Texture> textures;
  std::shared_ptr<const MeshMotion> motion;  // null: it is as it is

  [[nodiscard]] std::size_t triangle_count() const { return indices.size() / 3; }
  [[nodiscard]] Eigen::AlignedBox3f Bounds() const;
};

// What a file may ask of us; beyond it a model is refused, by name of the limit.
struct ModelLimits {
  static constexpr std::size_t kFileBytes = 256u << 20;   // one file (model, buffer)
  static constexpr std::size_t kTotalBytes = 512u << 20;  // all files and buffers of one model
  static constexpr std::size_t kJsonBytes = 64u << 20;    // the JSON part of a glTF
  static constexpr std::size_t kJsonTokens = 2'000'000;  // separators in that JSON: bounds its tree in memory
  static constexpr int kJsonDepth = 64;
  static constexpr std::size_t kVertices = 5'000'000;
  static constexpr std::size_t kTriangles = 10'000'000;
  static constexpr int kTextureSide = 8192;                 // px
  static constexpr std::size_t kTexturePixels = 96u << 20;  // all textures of one model together
  static constexpr std::size_t kParts = 65'536;
};

// Appends b's triangles to a. b's parts name materials of a; uvs and colors are filled where only one has
// them.
void AppendTriangles(Mesh& a, Mesh&& b);

// Smooth normals, weighted by the corner's angle, for all vertices that share a position index
// (position_of_vertex: one entry a vertex; empty = the vertex itself).
void SmoothNormals(Mesh& mesh, const std::vector<std::uint32_t>& position_of_vertex);

// Every triangle gets its own three vertices and its face's normal (what glTF asks for where normals are
// missing).
void FlatNormals(Mesh& mesh);

}  // namespace mixstage
