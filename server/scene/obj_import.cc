// SPDX-License-Identifier: Apache-2.0
//
// Wavefront OBJ with its .mtl, parsed by tinyobjloader. It checks no index and cuts polygons with more than
// 255 corners short, so the text is looked over first and its polygons are cut into triangles here.
#include <tiny_obj_loader.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <string_view>
#include <tuple>
#include <unordered_map>

#include "proto/base/srgb.h"
#include "server/scene/model_file.h"
#include "server/scene/texture_file.h"

namespace mixstage {
namespace {

auto Bad(const std::string& what) { return Fail(ErrorCode::kBadInput, what); }

constexpr std::size_t kCornersOfAFace = 255;
constexpr std::size_t kMaterialBytes = 16u << 20;
constexpr std::size_t kMaterials = 4096;

struct TextSummary {
  std::vector<std::string> material_files;
};

// One look over the lines: how much they will take, and which material files they name. Points, lines and
// subdivision tags, which nothing here uses, become comments: tinyobjloader gives a tag up to 300 kB on its
// own word, and twelve bytes to each two of a line.
Result<TextSummary> LookOver(std::string& whole) {
  std::string_view text = whole;
  TextSummary summary;
  std::size_t vertices = 0;
  std::size_t triangles = 0;
  std::size_t line_number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of("\r\n"), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++line_number;
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (line.size() < 2) continue;
    if (line[0] == 't' || line[0] == 'l' || line[0] == 'p')
      whole[static_cast<std::size_t>(line.data() - whole.data())] = '#';
    if (line[0] == 'v') {
      ++vertices;
      // tinyobjloader reads as 0 what is no number.
      const std::string_view numbers = line.substr(
          line.find_first_of(" \t") == std::string_view::npos ? line.size() : line.find_first_of(" \t"));
      const std::size_t odd = numbers.find_first_not_of("0123456789+-.eE \t");
      if (odd != std::string_view::npos && numbers[odd] != '#') {
        return Bad("line " + std::to_string(line_number) + ": a coordinate that is not a number");
      }
    }
    if (line[0] == 'f' && (line[1] == ' ' || line[1] == '\t')) {
      std::size_t corners = 0;
      for (std::size_t i = 1; i + 1 < line.size(); ++i) {
        const bool gap = line[i] == ' ' || line[i] == '\t';
        if (gap && line[i + 1] != ' ' && line[i + 1] != '\t') ++corners;
      }
      if (corners > kCornersOfAFace) {
        return Bad("line " + std::to_string(line_number) +
                   ": a face of more than 255 corners; triangulate it");
      }
      triangles += corners;
    }
    if (line.rfind("mtllib", 0) == 0 && line.size() > 7 && summary.material_files.size() < 16) {
      std::string name(line.substr(7));
      while (!name.empty() && (name.back() == ' ' || name.back() == '\t')) name.pop_back();
      summary.material_files.push_back(std::move(name));
    }
  }
  // Positions, texture coordinates and normals are separate lists, hence the factor.
  if (vertices > 3 * ModelLimits::kVertices) return Bad("has too many vertices (limit 5 million)");
  if (triangles > ModelLimits::kTriangles) return Bad("has too many triangles (limit 10 million)");
  return summary;
}

std::string ReadMaterialFiles(const TextSummary& summary, const std::filesystem::path& folder,
                              std::vector<std::string>& warnings) {
  std::string text;
  for (const std::string& name : summary.material_files) {
    auto file = ResolveInside(folder, name);
    auto bytes = file ? ReadFileBytes(*file, kMaterialBytes)
                      : Result<std::vector<std::uint8_t>>(tl::unexpected(file.error()));
    if (!bytes) {
      warnings.push_back("its materials are left out: " + bytes.error().message);
      continue;
    }
    text.append(bytes->begin(), bytes->end());
    text += '\n';
  }
  return text;
}

float Unit(float value, float otherwise) {
  return std::isfinite(value) ? std::clamp(value, 0.0f, 1.0f) : otherwise;
}

// Kd is taken as an sRGB colour, as viewers of OBJ show it.
Material ReadMaterial(const tinyobj::material_t& source) {
  Material material;
  material.name = source.name.substr(0, 128);
  for (int c = 0; c < 3; ++c) material.base_color[c] = LinearOfSrgb(Unit(source.diffuse[c], 1));
  material.base_alpha = Unit(source.dissolve, 1);
  material.alpha_mask = true;
  material.metallic = Unit(source.metallic, 0);
  // Without the PBR extension: Phong's exponent n and roughness^2 = sqrt(2 / (n + 2)).
  material.roughness = source.roughness > 0   ? Unit(source.roughness, 0.8f)
                       : source.shininess > 1 ? Unit(std::pow(2.0f / (source.shininess + 2.0f), 0.25f), 0.8f)
                                              : 0.8f;
  return material;
}

void ReadMaterials(const std::vector<tinyobj::material_t>& sources, const std::filesystem::path& folder,
                   LoadedModel& out) {
  std::map<std::string, int> texture_of_name;
  std::size_t remaining_pixels = ModelLimits::kTexturePixels;
  for (const tinyobj::material_t& source : sources) {
    Material material = ReadMaterial(source);
    if (!source.diffuse_texname.empty()) {
      std::string name = source.diffuse_texname;
      std::replace(name.begin(), name.end(), '\\', '/');
      auto [known, is_new] = texture_of_name.try_emplace(name, -1);
      if (is_new) {
        auto file = ResolveInside(folder, name);
        auto bytes = file ? ReadFileBytes(*file, ModelLimits::kFileBytes)
                          : Result<std::vector<std::uint8_t>>(tl::unexpected(file.error()));
        auto picture = bytes ? DecodeTexture(*bytes, remaining_pixels)
                             : Result<cv::Mat4b>(tl::unexpected(bytes.error()));
        if (picture) {
          known->second = static_cast<int>(out.mesh.textures.size());
          out.mesh.textures.push_back({*picture, TextureWrap::kRepeat, TextureWrap::kRepeat});
        } else {
          out.warnings.push_back("material " + material.name +
                                 " is drawn without its texture: " + picture.error().message);
        }
      }
      material.texture = known->second;
      // With a picture, exporters leave Kd at some grey that is not meant to darken it.
      if (material.texture >= 0) material.base_color.setOnes();
    }
    out.mesh.materials.push_back(std::move(material));
  }
  Material standard;
  standard.name = "default";
  out.mesh.materials.push_back(standard);
}

// Cuts a polygon by clipping ears in the plane of its largest projection; corners: position indices, in
// range. Appends positions in 0..corners.size()-1, three a triangle. What no ear is left of (self-crossing)
// becomes a fan.
void Triangulate(const std::vector<Eigen::Vector3f>& corners, std::vector<std::size_t>& out) {
  const std::size_t n = corners.size();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < n; ++i) {
    normal += corners[i].cast<double>().cross(corners[(i + 1) % n].cast<double>());
  }
  int dropped = 0;
  normal.cwiseAbs().maxCoeff(&dropped);
  const int x = (dropped + 1) % 3;
  const int y = (dropped + 2) % 3;
  const double turn = normal[dropped] < 0 ? -1.0 : 1.0;
  auto area = [&](std::size_t a, std::size_t b, std::size_t c) {
    const Eigen::Vector3d ab = (corners[b] - corners[a]).cast<double>();
    const Eigen::Vector3d ac = (corners[c] - corners[a]).cast<double>();
    return turn * (ab[x] * ac[y] - ab[y] * ac[x]);
  };
  std::vector<std::size_t> left(n);
  for (std::size_t i = 0; i < n; ++i) left[i] = i;
  while (left.size() > 3) {
    std::size_t ear = 0;  // a fan from the first corner when none is found
    for (std::size_t k = 0; k < left.size(); ++k) {
      const std::size_t a = left[(k + left.size() - 1) % left.size()];
      const std::size_t b = left[k];
      const std::size_t c = left[(k + 1) % left.size()];
      if (area(a, b, c) <= 0) continue;
      const bool empty = std::none_of(left.begin(), left.end(), [&](std::size_t p) {
        return p != a && p != b && p != c && area(a, b, p) > 0 && area(b, c, p) > 0 && area(c, a, p) > 0;
      });
      if (empty) {
        ear = k;
        break;
      }
    }
    out.insert(out.end(),
               {left[(ear + left.size() - 1) % left.size()], left[ear], left[(ear + 1) % left.size()]});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  out.insert(out.end(), {left[0], left[1], left[2]});
}

struct CornerHash {
  std::size_t operator()(const std::array<int, 3>& k) const {
    std::uint64_t h = 0;
    for (const int v : k) h = (h ^ static_cast<std::uint32_t>(v)) * 0x9E3779B97F4A7C15u;
    return h ^ h >> 29;
  }
};

// Corners (position, texture coordinate, normal) become vertices; triangles are collected a material.
class Builder {
 public:
  Builder(const tinyobj::attrib_t& attributes, LoadedModel& out)
      : attributes_(attributes), mesh_(out.mesh), by_material_(out.mesh.materials.size()) {}

  Status AddShape(const tinyobj::mesh_t& shape) {
    std::size_t first = 0;
    std::vector<Eigen::Vector3f> corners;
    std::vector<std::size_t> cut;
    for (std::size_t face = 0; face < shape.num_face_vertices.size(); ++face) {
      const std::size_t n = shape.num_face_vertices[face];
      if (n > shape.indices.size() - first) return Bad("has a face that is cut short");
      corners.clear();
      for (std::size_t i = 0; i < n; ++i) {
        if (auto ok = CheckCorner(shape.indices[first + i]); !ok) return ok;
        corners.push_back(Position(shape.indices[first + i].vertex_index));
      }
      cut.clear();
      if (n >= 3) Triangulate(corners, cut);
      const int material = face < shape.material_ids.size() ? shape.material_ids[face] : -1;
      const bool known = material >= 0 && static_cast<std::size_t>(material) + 1 < by_material_.size();
      std::vector<std::uint32_t>& indices =
          known ? by_material_[static_cast<std::size_t>(material)] : by_material_.back();
      for (const std::size_t i : cut) indices.push_back(Vertex(shape.indices[first + i]));
      if (mesh_.positions.size() > ModelLimits::kVertices)
        return Bad("has too many vertices (limit 5 million)");
      first += n;
    }
    return {};
  }

  void Finish() {
    for (std::size_t m = 0; m < by_material_.size(); ++m) {
      if (by_material_[m].empty()) continue;
      mesh_.parts.push_back({static_cast<std::uint32_t>(mesh_.indices.size()),
                             static_cast<std::uint32_t>(by_material_[m].size()), static_cast<int>(m)});
      mesh_.indices.insert(mesh_.indices.end(), by_material_[m].begin(), by_material_[m].end());
    }
    if (!has_uvs_) mesh_.uvs.clear();
    if (lacks_normals_) {
      SmoothNormals(mesh_, position_of_vertex_);
      return;
    }
    for (Eigen::Vector3f& n : mesh_.normals) {
      const float length = n.norm();
      n = std::isfinite(length) && length > 1e-20f ? Eigen::Vector3f(n / length) : Eigen::Vector3f::UnitY();
    }
  }

 private:
  Eigen::Vector3f Position(int i) const {
    return Eigen::Vector3f(attributes_.vertices.data() + 3 * static_cast<std::size_t>(i));
  }

  Status CheckCorner(const tinyobj::index_t& c) const {
    auto inside = [](int i, std::size_t count) { return i >= 0 && static_cast<std::size_t>(i) < count; };
    if (!inside(c.vertex_index, attributes_.vertices.size() / 3))
      return Bad("has a face with a vertex that does not exist");
    if (c.texcoord_index != -1 && !inside(c.texcoord_index, attributes_.texcoords.size() / 2)) {
      return Bad("has a face with a texture coordinate that does not exist");
    }
    if (c.normal_index != -1 && !inside(c.normal_index, attributes_.normals.size() / 3)) {
      return Bad("has a face with a normal that does not exist");
    }
    return {};
  }

  std::uint32_t Vertex(const tinyobj::index_t& c) {
    const auto [found, is_new] =
        vertex_of_corner_.try_emplace({c.vertex_index, c.texcoord_index, c.normal_index},
                                      static_cast<std::uint32_t>(mesh_.positions.size()));
    if (!is_new) return found->second;
    mesh_.positions.push_back(Position(c.vertex_index));
    position_of_vertex_.push_back(static_cast<std::uint32_t>(c.vertex_index));
    Eigen::Vector2f uv = Eigen::Vector2f::Zero();
    if (c.texcoord_index >= 0) {
      const float* source = attributes_.texcoords.data() + 2 * static_cast<std::size_t>(c.texcoord_index);
      uv = {source[0], 1.0f - source[1]};  // OBJ's v points up
      has_uvs_ = true;
    }
    mesh_.uvs.push_back(uv);
    lacks_normals_ |= c.normal_index < 0;
    mesh_.normals.push_back(
        c.normal_index < 0
            ? Eigen::Vector3f::UnitY().eval()
            : Eigen::Vector3f(attributes_.normals.data() + 3 * static_cast<std::size_t>(c.normal_index)));
    return found->second;
  }

  const tinyobj::attrib_t& attributes_;
  Mesh& mesh_;
  std::vector<std::vector<std::uint32_t>> by_material_;
  std::unordered_map<std::array<int, 3>, std::uint32_t, CornerHash> vertex_of_corner_;
  std::vector<std::uint32_t> position_of_vertex_;
  bool has_uvs_ = false, lacks_normals_ = false;
};

}  // namespace

Result<LoadedModel> ImportObj(const std::vector<std::uint8_t>& bytes, const std::filesystem::path& folder) {
  std::string text(bytes.begin(), bytes.end());
  auto summary = LookOver(text);
  if (!summary) return tl::unexpected(summary.error());
  LoadedModel out;
  tinyobj::ObjReaderConfig config;
  config.triangulate = false;
  config.vertex_color = false;
  tinyobj::ObjReader reader;
  if (!reader.ParseFromString(text, ReadMaterialFiles(*summary, folder, out.warnings), config)) {
    const std::string error = reader.Error().substr(0, reader.Error().find('\n'));
    return Bad(error.empty() ? "is no valid OBJ" : error.substr(0, 200));
  }
  if (reader.GetMaterials().size() > kMaterials) return Bad("has more than 4096 materials");
  ReadMaterials(reader.GetMaterials(), folder, out);
  Builder builder(reader.GetAttrib(), out);
  for (const tinyobj::shape_t& shape : reader.GetShapes()) {
    if (auto ok = builder.AddShape(shape.mesh); !ok) return tl::unexpected(ok.error());
  }
  builder.Finish();
  return out;
}

}  // namespace mixstage
