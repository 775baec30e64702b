// SPDX-License-Identifier: Apache-2.0
#include "server/raster/egl_rasteriser.h"

#include <mixstage_shaders/raster.h>
#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>

#include "proto/base/check.h"
#include "proto/base/log.h"
#include "server/gl/clip_space.h"

namespace mixstage::raster {
namespace {

// Beyond it (walls behind walls that all fill the view) a picture is scanned here, bit by bit: bounds the
// record.
constexpr std::size_t kMostSplitTriangles = 1u << 20;
// Outputs of shaders/scan.frag.
constexpr int kDepth = 0;
constexpr int kTriangle = 1;

// Decides about triangles as ScanTriangles does and does not draw: the numbers of those that must be split go
// to needs_split, touched grows by the box of those that may be seen. Triangles that the GPU must not draw as
// they are lose their area instead of their place, so that the others keep their numbers.
void Sift(std::span<const ProjectedVertex> vertices, std::span<std::uint32_t> indices, Faces faces,
          bool mirrored, std::int32_t max_edge, const ScanTarget& clip,
          std::vector<std::uint32_t>& needs_split, TouchedBox& touched) {
  TouchedBox box = touched;
  for (std::size_t i = 0; i < indices.size(); i += 3) {
    const ProjectedVertex& a = vertices[indices[i]];
    const ProjectedVertex& b = vertices[indices[i + 1]];
    const ProjectedVertex& c = vertices[indices[i + 2]];
    const std::uint32_t any = a.outcode | b.outcode | c.outcode;
    const bool unseen = (a.outcode & b.outcode & c.outcode & kOutsideMask) != 0 || (any & kNotFinite) != 0;
    const bool drawable = (any & (kNeedsSplit | kNotFinite)) == 0;
    if (unseen) {
      if (!drawable) indices[i + 1] = indices[i + 2] = indices[i];
      continue;
    }
    const std::int32_t min_x = std::min({a.x, b.x, c.x});
    const std::int32_t max_x = std::max({a.x, b.x, c.x});
    const std::int32_t min_y = std::min({a.y, b.y, c.y});
    const std::int32_t max_y = std::max({a.y, b.y, c.y});
    if (!drawable || std::max(max_x - min_x, max_y - min_y) > max_edge) {
      needs_split.push_back(static_cast<std::uint32_t>(i / 3));
      continue;
    }
    const int x0 = std::max((min_x + kSubPixels - 1) >> kSubPixelBits, clip.x0);
    const int x1 = std::min(max_x >> kSubPixelBits, clip.x1);
    const int y0 = std::max((min_y + kSubPixels - 1) >> kSubPixelBits, clip.y0);
    const int y1 = std::min(max_y >> kSubPixelBits, clip.y1);
    const std::int32_t twice_area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    const bool front = mirrored ? twice_area > 0 : twice_area < 0;
    if (x0 > x1 || y0 > y1 || twice_area == 0 || (faces == Faces::kFrontOnly && !front)) continue;
    box = {std::min(box.x0, x0), std::min(box.y0, y0), std::max(box.x1, x1), std::max(box.y1, y1)};
  }
  touched = box;
}

void Cull(const gl::Current& current, Faces faces, bool mirrored) {
  if (faces == Faces::kBoth) return current->Disable(GL_CULL_FACE);
  current->Enable(GL_CULL_FACE);
  current->CullFace(GL_BACK);
  current->FrontFace(mirrored ? gl::ClockwiseInThePicture() : gl::CounterClockwiseInThePicture());
}

}  // namespace

Result<EglRasteriser::Targets> EglRasteriser::Targets::Create(const gl::Current& current, int width,
                                                              int height) {
  auto depth_m = gl::Texture::Create(current, GL_R32F, width, height);
  if (!depth_m) return tl::unexpected(depth_m.error());
  auto triangle = gl::Texture::Create(current, GL_R32I, width, height);
  if (!triangle) return tl::unexpected(triangle.error());
  auto depth = gl::Texture::Create(current, GL_DEPTH_COMPONENT32F, width, height);
  if (!depth) return tl::unexpected(depth.error());
  auto framebuffer = gl::Framebuffer::Create(current, {&*depth_m, &*triangle}, &*depth);
  if (!framebuffer) return tl::unexpected(framebuffer.error());
  return Targets{std::move(*depth_m), std::move(*triangle), std::move(*depth), std::move(*framebuffer)};
}

Result<EglRasteriser::Objects> EglRasteriser::Objects::Create(const gl::Current& current) {
  auto scan =
      gl::Program::Create(current, "scan", {shaders::corner_glsl, shaders::scan_vert}, {shaders::scan_frag});
  if (!scan) return tl::unexpected(scan.error());
  Objects objects{std::move(*scan),
                  gl::VertexArray::Create(current),
                  gl::Buffer::Create(current),
                  gl::Buffer::Create(current),
                  gl::BufferTexture::Create(current, GL_R32I),
                  {},
                  {},
                  {}};
  objects.vertex_array.SetVertices(current, objects.vertices, sizeof(ProjectedVertex));
  objects.vertex_array.SetIndices(current, objects.indices);
  objects.vertex_array.Integer(current, 0, 2, offsetof(ProjectedVertex, x));
  objects.vertex_array.Float(current, 1, 1, offsetof(ProjectedVertex, inverse_z));
  if (auto ok = current.Check("raster"); !ok) return tl::unexpected(ok.error());
  return objects;
}

EglRasteriser::EglRasteriser(const PinholeCamera& camera, const RasterConfig& config,
                             std::shared_ptr<gl::Gpu> gpu)
    : camera_(camera), picture_lens_(RasterLens::Of(camera, config.near_m)), gpu_(std::move(gpu)) {}

Result<EglRasteriser> EglRasteriser::Create(const PinholeCamera& camera, const RasterConfig& config,
                                            std::shared_ptr<gl::Gpu> gpu) {
  EglRasteriser egl(camera, config, std::move(gpu));
  // Drivers finish a program at its first draw, which takes up to a tenth of a second: now, not in a show.
  const std::vector<Eigen::Vector3f> corners = {{0, 0, 10}, {1, 0, 10}, {0, 1, 10}};
  const std::vector<std::uint32_t> indices = {0, 1, 2};
  egl.Begin({});
  egl.Draw({corners, indices}, Eigen::Affine3d::Identity(), 0, Faces::kBoth);
  auto current = egl.gpu_->Enter();
  if (!current) return Fail(ErrorCode::kUnavailable, "the GPU's context is lost");
  if (auto ok = egl.ScanAndRead(*current); !ok) return tl::unexpected(ok.error());
  return egl;
}

void EglRasteriser::Begin(const PictureGrid& grid) {
  const PinholeCamera grid_camera = grid.CameraOf(camera_);
  lens_ = picture_lens_.OnGrid(grid_camera, grid.scale);
  lens_.half_space = grid.half_space;
  clip_ = {nullptr, nullptr, 0, 0, 0, grid_camera.width - 1, grid_camera.height - 1};
  picture_.Begin(grid_camera.width, grid_camera.height);
  batches_.clear();
  vertices_.clear();
  indices_.clear();
  ids_.clear();
  touched_ = {};
  partly_here_ = false;
  stage_ = Stage::kRecording;
}

void EglRasteriser::Draw(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
                         Faces faces) {
  MIX_CHECK(first_id >= 0);
  Batch batch;
  batch.first_id = first_id;
  batch.faces = faces;
  Record(mesh, T_camera_object, batch);
}

void EglRasteriser::DrawDepth(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object,
                              Faces faces) {
  Batch batch;
  batch.faces = faces;
  batch.with_ids = false;
  Record(mesh, T_camera_object, batch);
}

void EglRasteriser::Record(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object,
                           Batch batch) {
  MIX_CHECK(stage_ == Stage::kRecording);  // Begin comes first
  mesh.Check();
  if (mesh.indices.empty()) return;
  const Affine34 T = Affine34::Of(T_camera_object);
  batch.mirrored = T_camera_object.linear().determinant() < 0;
  batch.first_vertex = vertices_.size();
  batch.vertices = mesh.positions.size();
  batch.first_index = indices_.size();
  batch.indices = mesh.indices.size();
  vertices_.resize(vertices_.size() + batch.vertices);
  const auto projected = std::span(vertices_).subspan(batch.first_vertex);
  ProjectVertices(lens_, T, mesh.positions, projected);
  lens_.CutOff(T, mesh.positions, projected);
  indices_.insert(indices_.end(), mesh.indices.begin(), mesh.indices.end());
  batches_.push_back(batch);

  const auto indices = std::span(indices_).subspan(batch.first_index);
  needs_split_.clear();
  Sift(projected, indices, batch.faces, batch.mirrored, lens_.max_edge, clip_, needs_split_, touched_);
  for (const std::uint32_t t : needs_split_) {
    std::uint32_t* index = &indices_[batch.first_index + 3 * std::size_t{t}];
    CameraCorner corners[3];
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = {T * mesh.positions[index[k]], vertices_[batch.first_vertex + index[k]]};
    }
    SplitTriangle(lens_, corners[0], corners[1], corners[2], batch.first_id + static_cast<std::int32_t>(t),
                  clip_, split_);
    index[1] = index[2] = index[0];
    if (split_.ids.size() < kMostSplitTriangles) continue;
    partly_here_ = true;
    ScanHere(batch, split_.vertices, split_.indices, split_.ids);
    split_.Clear();
  }
  RecordSplit(batch);
}

void EglRasteriser::RecordSplit(const Batch& like) {
  if (split_.ids.empty()) return;
  Batch batch = like;
  batch.first_vertex = vertices_.size();
  batch.vertices = split_.vertices.size();
  batch.first_index = indices_.size();
  batch.indices = split_.indices.size();
  batch.first_listed = static_cast<std::ptrdiff_t>(ids_.size());
  vertices_.insert(vertices_.end(), split_.vertices.begin(), split_.vertices.end());
  indices_.insert(indices_.end(), split_.indices.begin(), split_.indices.end());
  ids_.insert(ids_.end(), split_.ids.begin(), split_.ids.end());
  batches_.push_back(batch);
  split_.Clear();
  Sift(std::span(vertices_).subspan(batch.first_vertex), std::span(indices_).subspan(batch.first_index),
       batch.faces, batch.mirrored, lens_.max_edge, clip_, never_split_, touched_);
  MIX_CHECK(never_split_.empty());
}

const VisibilityBuffer& EglRasteriser::Finish() {
  if (stage_ == Stage::kFinished) return picture_.buffer();
  stage_ = Stage::kFinished;
  if (!partly_here_) {
    if (auto current = gpu_->Enter()) {
      const Status ok = ScanAndRead(*current);
      if (ok) return picture_.buffer();
      Report(ok.error());
    }
  }
  for (const Batch& batch : batches_) {
    std::span<const std::int32_t> ids;
    if (batch.first_listed >= 0) {
      ids = std::span(ids_).subspan(static_cast<std::size_t>(batch.first_listed), batch.indices / 3);
    }
    ScanHere(batch, std::span(vertices_).subspan(batch.first_vertex, batch.vertices),
             std::span(indices_).subspan(batch.first_index, batch.indices), ids);
  }
  return picture_.Finish();
}

void EglRasteriser::ScanHere(const Batch& batch, std::span<const ProjectedVertex> vertices,
                             std::span<const std::uint32_t> indices, std::span<const std::int32_t> ids) {
  ScanBatch scan;
  scan.vertices = vertices;
  scan.indices = indices;
  scan.ids = ids;
  scan.first_id = batch.first_id;
  scan.faces = batch.faces;
  scan.mirrored = batch.mirrored;
  scan.max_edge = lens_.max_edge;
  ScanTriangles(scan, batch.with_ids ? picture_.Target() : picture_.DepthTarget(), never_split_,
                picture_.touched());
  never_split_.clear();  // triangles that were split have lost their area, but not the corner without a pixel
}

const gl::Texture* EglRasteriser::FinishOnGpu(const gl::Current& current) {
  if (partly_here_) return nullptr;
  if (auto ok = Scan(current); !ok) {
    Report(ok.error());
    return nullptr;
  }
  return &objects_.In(*gpu_, current, &Objects::Create)->targets->triangle;
}

Status EglRasteriser::Scan(const gl::Current& current) {
  Objects* o = objects_.In(*gpu_, current, &Objects::Create);
  if (o == nullptr) return tl::unexpected(objects_.failure());
  const int width = clip_.x1 + 1;
  const int height = clip_.y1 + 1;
  if (!o->targets || o->targets->depth.width() < width || o->targets->depth.height() < height) {
    const int wide = std::max(width, o->targets ? o->targets->depth.width() : 0);
    const int high = std::max(height, o->targets ? o->targets->depth.height() : 0);
    o->targets.reset();
    auto targets = Targets::Create(current, wide, high);
    if (!targets) return tl::unexpected(targets.error());
    o->targets = std::move(*targets);
  }
  o->vertices.Write(current, std::span<const ProjectedVertex>(vertices_));
  o->indices.Write(current, std::span<const std::uint32_t>(indices_));
  if (auto ok = o->ids.Write(current, std::span<const std::int32_t>(ids_), ids_.size()); !ok) return ok;

  const gl::Framebuffer& framebuffer = o->targets->framebuffer;
  framebuffer.Bind(current, width, height);
  gl::UseClipFromPixel(current);
  current->Disable(GL_BLEND);
  current->Enable(GL_DEPTH_TEST);
  current->DepthMask(GL_TRUE);
  current->DepthFunc(GL_GREATER);  // strictly: of equal depths the first drawn stays
  current->ColorMaski(kTriangle, GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  framebuffer.ClearColor(current, kDepth, 0.0f);
  framebuffer.ClearColor(current, kTriangle, -1);
  framebuffer.ClearDepth(current, 0.0f);
  o->scan.Use(current);
  o->scan.SetMatrix(current, "T_clip_pixel", gl::ClipFromPixel(width, height, lens_.near_m).data());
  o->scan.Set(current, "ids", 0);
  o->ids.Bind(current, 0);
  o->vertex_array.Bind(current);
  for (const Batch& batch : batches_) {
    Cull(current, batch.faces, batch.mirrored);
    const GLboolean with_ids = batch.with_ids ? GL_TRUE : GL_FALSE;
    current->ColorMaski(kTriangle, with_ids, with_ids, with_ids, with_ids);
    o->scan.Set(current, "first_id", batch.first_id);
    o->scan.Set(current, "first_listed", static_cast<int>(batch.first_listed));
    current->DrawElementsBaseVertex(
        GL_TRIANGLES, static_cast<GLsizei>(batch.indices), GL_UNSIGNED_INT,
        reinterpret_cast<const void*>(batch.first_index * sizeof(std::uint32_t)),  // an offset, in GL's way
        static_cast<GLint>(batch.first_vertex));
  }
  return current.Check("raster");
}

Status EglRasteriser::ScanAndRead(const gl::Current& current) {
  if (auto ok = Scan(current); !ok) return ok;
  const cv::Rect box = RectOf(touched_);
  if (box.empty()) return {};
  Objects& o = *objects_.In(*gpu_, current, &Objects::Create);
  const bool with_ids =
      std::any_of(batches_.begin(), batches_.end(), [](const Batch& batch) { return batch.with_ids; });
  const gl::Framebuffer& from = o.targets->framebuffer;
  if (auto ok = o.depth_m.Start(current, from, kDepth, box, GL_RED, GL_FLOAT, sizeof(float)); !ok) return ok;
  if (with_ids) {
    auto ok = o.triangle.Start(current, from, kTriangle, box, GL_RED_INTEGER, GL_INT, sizeof(std::int32_t));
    if (!ok) return ok;
  }
  auto depth_m = o.depth_m.Wait(current);
  if (!depth_m) return tl::unexpected(depth_m.error());
  const std::int32_t* triangle = nullptr;
  if (with_ids) {
    auto read = o.triangle.Wait(current);
    if (!read) return tl::unexpected(read.error());
    triangle = reinterpret_cast<const std::int32_t*>(read->data());
  }
  picture_.Take(touched_, reinterpret_cast<const float*>(depth_m->data()), triangle);
  return {};
}

// Once: a driver that refuses one picture will refuse the next, and a lost context is reported by Gpu.
void EglRasteriser::Report(const Error& error) {
  if (reported_ || error.code == ErrorCode::kUnavailable) return;
  reported_ = true;
  spdlog::warn("raster event=drawn_on_cpu reason=\"{}\"", error.message);
}

}  // namespace mixstage::raster
