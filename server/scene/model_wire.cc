// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_wire.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <type_traits>

namespace mixstage {
namespace {

constexpr std::uint32_t kMagic = 0x314D584D;  // "MXM1"
constexpr std::uint32_t kModel = 1, kRefusal = 2;
constexpr std::size_t kMostTextBytes = 2048;
constexpr std::size_t kMostWarnings = 100;

// The numbers of a material, in this order.
struct MaterialNumbers {
  std::array<float, 3> base_color{};
  float base_alpha = 0, metallic = 0, roughness = 0, alpha_cutoff = 0;
  std::int32_t texture = 0;
  std::uint32_t double_sided = 0, alpha_mask = 0;
};

// Of a track, before its lists.
struct TrackNumbers {
  std::int32_t node = 0;
  MotionPath path = MotionPath::kTranslation;
  MotionStep step = MotionStep::kLinear;
};

class Writer {
 public:
  explicit Writer(const WriteBytes& write) : write_(write) {}
  void Bytes(const void* bytes, std::size_t count) { ok_ = ok_ && (count == 0 || write_(bytes, count)); }
  void U32(std::size_t value) {
    const auto v = static_cast<std::uint32_t>(value);
    Bytes(&v, sizeof v);
  }
  void Text(const std::string& text) {
    const std::size_t size = std::min(text.size(), kMostTextBytes);
    U32(size);
    Bytes(text.data(), size);
  }
  template <typename T>
  void List(const std::vector<T>& values) {
    U32(values.size());
    Bytes(values.data(), values.size() * sizeof(T));
  }
  [[nodiscard]] bool ok() const { return ok_; }

 private:
  const WriteBytes& write_;
  bool ok_ = true;
};

// After a failure nothing more is read and every value is 0.
class Reader {
 public:
  explicit Reader(const ReadBytes& read) : read_(read) {}
  void Bytes(void* bytes, std::size_t count) { ok_ = ok_ && (count == 0 || read_(bytes, count)); }
  std::uint32_t U32(std::size_t most) {
    std::uint32_t value = 0;
    Bytes(&value, sizeof value);
    ok_ = ok_ && value <= most;
    return ok_ ? value : 0;
  }
  std::string Text() {
    std::string text(U32(kMostTextBytes), '\0');
    Bytes(text.data(), text.size());
    return text;
  }
  template <typename T>
  void List(std::vector<T>& values, std::size_t most) {
    values.resize(U32(most));
    Bytes(values.data(), values.size() * sizeof(T));
  }
  void Fits(bool condition) { ok_ = ok_ && condition; }
  [[nodiscard]] bool ok() const { return ok_; }

 private:
  const ReadBytes& read_;
  bool ok_ = true;
};

void WriteMotion(const MeshMotion& motion, Writer& out) {
  out.List(motion.nodes);
  out.List(motion.bones);
  out.List(motion.vertices);
  out.List(motion.bind_positions);
  out.List(motion.bind_normals);
  out.U32(motion.clips.size());
  for (const MotionClip& clip : motion.clips) {
    out.Text(clip.name);
    out.Bytes(&clip.duration_s, sizeof clip.duration_s);
    out.U32(clip.tracks.size());
    for (const MotionTrack& track : clip.tracks) {
      const TrackNumbers numbers{track.node, track.path, track.step};
      out.Bytes(&numbers, sizeof numbers);
      out.List(track.times_s);
      out.List(track.values);
    }
  }
}

void WriteMesh(const Mesh& mesh, Writer& out) {
  out.List(mesh.positions);
  out.List(mesh.normals);
  out.List(mesh.uvs);
  out.List(mesh.colors);
  out.List(mesh.indices);
  out.U32(mesh.parts.size());
  for (const MeshPart& part : mesh.parts) {
    out.U32(part.first_index);
    out.U32(part.index_count);
    out.U32(static_cast<std::size_t>(part.material));
  }
  out.U32(mesh.materials.size());
  for (const Material& m : mesh.materials) {
    out.Text(m.name);
    const MaterialNumbers numbers{{m.base_color.x(), m.base_color.y(), m.base_color.z()},
                                  m.base_alpha,
                                  m.metallic,
                                  m.roughness,
                                  m.alpha_cutoff,
                                  m.texture,
                                  m.double_sided,
                                  m.alpha_mask};
    out.Bytes(&numbers, sizeof numbers);
  }
  out.U32(mesh.motion != nullptr ? 1 : 0);
  if (mesh.motion != nullptr) WriteMotion(*mesh.motion, out);
  out.U32(mesh.textures.size());
  for (const Texture& texture : mesh.textures) {
    out.U32(static_cast<std::size_t>(texture.wrap_u));
    out.U32(static_cast<std::size_t>(texture.wrap_v));
    out.U32(static_cast<std::size_t>(texture.rgba.cols));
    out.U32(static_cast<std::size_t>(texture.rgba.rows));
    for (int y = 0; y < texture.rgba.rows; ++y) {
      out.Bytes(texture.rgba.ptr(y), static_cast<std::size_t>(texture.rgba.cols) * 4);
    }
  }
}

void ReadMaterial(Reader& in, Material& m) {
  m.name = in.Text();
  MaterialNumbers numbers;
  in.Bytes(&numbers, sizeof numbers);
  m.base_color = Eigen::Vector3f(numbers.base_color[0], numbers.base_color[1], numbers.base_color[2]);
  in.Fits(m.base_color.allFinite());
  for (const float share : {numbers.base_alpha, numbers.metallic, numbers.roughness}) {
    in.Fits(share >= 0 && share <= 1);
  }
  in.Fits(std::isfinite(numbers.alpha_cutoff) && numbers.texture >= -1);
  m.base_alpha = numbers.base_alpha;
  m.metallic = numbers.metallic;
  m.roughness = numbers.roughness;
  m.alpha_cutoff = numbers.alpha_cutoff;
  m.texture = numbers.texture;
  m.double_sided = numbers.double_sided != 0;
  m.alpha_mask = numbers.alpha_mask != 0;
}

void ReadTexture(Reader& in, std::size_t& remaining_pixels, Texture& texture) {
  constexpr auto kLastWrap = static_cast<std::size_t>(TextureWrap::kMirror);
  const std::uint32_t wrap_u = in.U32(kLastWrap);
  const std::uint32_t wrap_v = in.U32(kLastWrap);
  const std::uint32_t width = in.U32(ModelLimits::kTextureSide);
  const std::uint32_t height = in.U32(ModelLimits::kTextureSide);
  const std::size_t pixels = std::size_t{width} * height;
  in.Fits(wrap_u > 0 && wrap_v > 0 && pixels > 0 && pixels <= remaining_pixels);
  if (!in.ok()) return;
  remaining_pixels -= pixels;
  texture.wrap_u = static_cast<TextureWrap>(wrap_u);
  texture.wrap_v = static_cast<TextureWrap>(wrap_v);
  texture.rgba.create(static_cast<int>(height), static_cast<int>(width));
  in.Bytes(texture.rgba.ptr(), pixels * 4);
}

// What it says is checked with the mesh (CheckMotion); its counts here.
std::shared_ptr<const MeshMotion> ReadMotion(Reader& in) {
  auto motion = std::make_shared<MeshMotion>();
  in.List(motion->nodes, MeshMotion::kMostNodes);
  in.List(motion->bones, MeshMotion::kMostBones);
  in.List(motion->vertices, ModelLimits::kVertices);
  in.List(motion->bind_positions, ModelLimits::kVertices);
  in.List(motion->bind_normals, ModelLimits::kVertices);
  motion->clips.resize(in.U32(MeshMotion::kMostClips));
  std::size_t tracks_left = MeshMotion::kMostTracks, numbers_left = MeshMotion::kMostNumbers;
  for (MotionClip& clip : motion->clips) {
    clip.name = in.Text();
    in.Bytes(&clip.duration_s, sizeof clip.duration_s);
    clip.tracks.resize(in.U32(tracks_left));
    tracks_left -= clip.tracks.size();
    for (MotionTrack& track : clip.tracks) {
      if (!in.ok()) return motion;
      TrackNumbers numbers;
      in.Bytes(&numbers, sizeof numbers);
      track.node = numbers.node;
      track.path = numbers.path;
      track.step = numbers.step;
      in.List(track.times_s, numbers_left);
      numbers_left -= track.times_s.size();
      in.List(track.values, numbers_left);
      numbers_left -= track.values.size();
    }
  }
  return motion;
}

void ReadMesh(Reader& in, Mesh& mesh) {
  in.List(mesh.positions, ModelLimits::kVertices);
  in.List(mesh.normals, ModelLimits::kVertices);
  in.List(mesh.uvs, ModelLimits::kVertices);
  in.List(mesh.colors, ModelLimits::kVertices);
  in.List(mesh.indices, 3 * ModelLimits::kTriangles);
  mesh.parts.resize(in.U32(3 * ModelLimits::kParts));
  for (MeshPart& part : mesh.parts) {
    part.first_index = in.U32(3 * ModelLimits::kTriangles);
    part.index_count = in.U32(3 * ModelLimits::kTriangles);
    part.material = static_cast<int>(in.U32(ModelLimits::kParts));
  }
  mesh.materials.resize(in.U32(ModelLimits::kParts + 1));
  for (Material& material : mesh.materials) {
    if (!in.ok()) return;
    ReadMaterial(in, material);
  }
  if (in.U32(1) != 0) mesh.motion = ReadMotion(in);
  if (!in.ok()) return;
  mesh.textures.resize(in.U32(ModelLimits::kParts));
  std::size_t remaining_pixels = ModelLimits::kTexturePixels;
  for (Texture& texture : mesh.textures) {
    if (!in.ok()) return;
    ReadTexture(in, remaining_pixels, texture);
  }
}

static_assert(std::is_trivially_copyable_v<MaterialNumbers> && std::is_trivially_copyable_v<MotionNode> &&
              std::is_trivially_copyable_v<MotionBone> && std::is_trivially_copyable_v<VertexBones>);
static_assert(sizeof(Eigen::Vector3f) == 12 && sizeof(Eigen::Vector2f) == 8,
              "lists of them are plain floats");

}  // namespace

bool WriteModel(const Result<LoadedModel>& model, const WriteBytes& write) {
  Writer out(write);
  out.U32(kMagic);
  if (!model) {
    out.U32(kRefusal);
    out.U32(static_cast<std::size_t>(model.error().code));
    out.Text(model.error().message);
    return out.ok();
  }
  out.U32(kModel);
  out.U32(static_cast<std::size_t>(model->up));
  const std::size_t warnings = std::min(model->warnings.size(), kMostWarnings);
  out.U32(warnings);
  for (std::size_t i = 0; i < warnings; ++i) out.Text(model->warnings[i]);
  WriteMesh(model->mesh, out);
  return out.ok();
}

Result<LoadedModel> ReadModel(const ReadBytes& read) {
  const auto broken = [] { return Fail(ErrorCode::kInternal, "the importer's answer is broken off"); };
  Reader in(read);
  const bool ours = in.U32(kMagic) == kMagic;
  const std::uint32_t kind = in.U32(kRefusal);
  if (!ours || !in.ok()) return broken();
  if (kind == kRefusal) {
    const std::uint32_t code = in.U32(static_cast<std::size_t>(ErrorCode::kInternal));
    std::string message = in.Text();
    if (!in.ok() || code == 0) return broken();
    for (char& c : message) c = static_cast<unsigned char>(c) < ' ' ? ' ' : c;  // one line, whoever wrote it
    return Fail(static_cast<ErrorCode>(code), std::move(message));
  }
  LoadedModel model;
  const std::uint32_t up = in.U32(static_cast<std::size_t>(UpAxis::kZ));
  model.warnings.resize(in.U32(kMostWarnings));
  for (std::string& warning : model.warnings) warning = in.Text();
  ReadMesh(in, model.mesh);
  if (!in.ok() || kind != kModel || up == 0) return broken();
  model.up = static_cast<UpAxis>(up);
  if (auto ok = CheckMesh(model.mesh); !ok) return Fail(ErrorCode::kInternal, ok.error().message);
  return model;
}

}  // namespace mixstage
