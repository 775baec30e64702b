// SPDX-License-Identifier: Apache-2.0
#include "server/depth/egl_grid_scan.h"

#include <mixstage_shaders/depth.h>
#include <mixstage_shaders/raster.h>
#include <algorithm>
#include <array>
#include <cstring>

#include "proto/base/check.h"
#include "server/gl/clip_space.h"

namespace mixstage::depth {

EglGridScan::Cells EglGridScan::Cells::Create(const gl::Current& current) {
  return {gl::BufferTexture::Create(current, GL_R32I), gl::BufferTexture::Create(current, GL_R32I),
          gl::BufferTexture::Create(current, GL_R32I), gl::BufferTexture::Create(current, GL_R32F),
          gl::BufferTexture::Create(current, GL_R8UI)};
}

void EglGridScan::Cells::Bind(const gl::Current& current, const gl::Program& program) const {
  const std::array<std::pair<const char*, const gl::BufferTexture*>, 5> buffers = {
      {{"corner_x", &x},
       {"corner_y", &y},
       {"corner_outcode", &outcode},
       {"corner_inverse_z", &inverse_z},
       {"cells", &cells}}};
  for (std::size_t unit = 0; unit < buffers.size(); ++unit) {
    program.Set(current, buffers[unit].first, static_cast<int>(unit));
    buffers[unit].second->Bind(current, static_cast<GLuint>(unit));
  }
}

Result<EglGridScan::Objects> EglGridScan::Make(const gl::Current& current) const {
  auto grid =
      gl::Program::Create(current, "grid", {shaders::corner_glsl, shaders::grid_vert}, {shaders::grid_frag});
  if (!grid) return tl::unexpected(grid.error());
  auto take =
      gl::Program::Create(current, "take_depth", {shaders::whole_picture_vert}, {shaders::take_depth_frag});
  if (!take) return tl::unexpected(take.error());
  auto surface = gl::Texture::Create(current, GL_DEPTH_COMPONENT32F, width_, height_);
  if (!surface) return tl::unexpected(surface.error());
  auto torn = gl::Texture::Create(current, GL_DEPTH_COMPONENT32F, width_, height_);
  if (!torn) return tl::unexpected(torn.error());
  auto depth_m = gl::Texture::Create(current, GL_R32F, width_, height_);
  if (!depth_m) return tl::unexpected(depth_m.error());
  auto to_surface = gl::Framebuffer::Create(current, {}, &*surface);
  if (!to_surface) return tl::unexpected(to_surface.error());
  auto to_torn = gl::Framebuffer::Create(current, {}, &*torn);
  if (!to_torn) return tl::unexpected(to_torn.error());
  auto to_depth_m = gl::Framebuffer::Create(current, {&*depth_m}, nullptr);
  if (!to_depth_m) return tl::unexpected(to_depth_m.error());
  return Objects{std::move(*grid),       std::move(*take),       gl::VertexArray::Create(current),
                 Cells::Create(current), Cells::Create(current), std::move(*surface),
                 std::move(*torn),       std::move(*depth_m),    std::move(*to_surface),
                 std::move(*to_torn),    std::move(*to_depth_m), {}};
}

Result<EglGridScan> EglGridScan::Create(std::shared_ptr<gl::Gpu> gpu, const GridShape& shape, int width,
                                        int height, float near_m) {
  EglGridScan scan(std::move(gpu), shape, width, height, near_m);
  // An empty picture: drivers finish a program at its first draw, which must not be in a show.
  GridCorners corners, torn[4];
  corners.Resize(shape.size());
  for (GridCorners& corner : torn) corner.Resize(1);
  const std::vector<std::uint8_t> cells(shape.size(), 0);
  cv::Mat1f depth_m(height, width);
  if (auto ok = scan.Draw(corners, cells, torn, 1, View(depth_m)); !ok) return tl::unexpected(ok.error());
  return scan;
}

Status EglGridScan::Draw(const GridCorners& corners, std::span<const std::uint8_t> cells,
                         const GridCorners (&torn)[4], std::size_t count, ImageView<float> depth_m) {
  MIX_CHECK(depth_m.width() == width_ && depth_m.height() == height_);
  auto current = gpu_->Enter();
  if (!current) return Fail(ErrorCode::kUnavailable, "the GPU's context is lost");
  return DrawOn(*current, corners, cells, torn, count, depth_m);
}

Status EglGridScan::DrawOn(const gl::Current& current, const GridCorners& corners,
                           std::span<const std::uint8_t> cells, const GridCorners (&torn)[4],
                           std::size_t count, ImageView<float> depth_m) {
  Objects* o = objects_.In(*gpu_, current, [&](const gl::Current& c) { return Make(c); });
  if (o == nullptr) return tl::unexpected(objects_.failure());

  const Cells& surface = o->surface_cells;
  surface.x.buffer().Write(current, std::span<const std::int32_t>(corners.x));
  surface.y.buffer().Write(current, std::span<const std::int32_t>(corners.y));
  surface.outcode.buffer().Write(current, std::span<const std::int32_t>(corners.outcode));
  surface.inverse_z.buffer().Write(current, std::span<const float>(corners.inverse_z));
  surface.cells.buffer().Write(current, cells);
  // The four corners of torn cells one after the other.
  const Cells& edges = o->torn_cells;
  auto write_four = [&](const gl::BufferTexture& to, auto field) {
    using Value = std::remove_cvref_t<decltype(*field(torn[0]).data())>;
    to.buffer().Resize(current, 4 * count * sizeof(Value));
    for (std::size_t k = 0; k < 4; ++k) {
      to.buffer().Fill(current, k * count * sizeof(Value),
                       std::span<const Value>(field(torn[k])).first(count));
    }
  };
  write_four(
      edges.x, [](const GridCorners& c) -> const auto& { return c.x; });
  write_four(
      edges.y, [](const GridCorners& c) -> const auto& { return c.y; });
  write_four(
      edges.outcode, [](const GridCorners& c) -> const auto& { return c.outcode; });
  write_four(
      edges.inverse_z, [](const GridCorners& c) -> const auto& { return c.inverse_z; });
  whole_.resize(std::max(whole_.size(), count), kWhole);
  edges.cells.buffer().Write(current, std::span<const std::uint8_t>(whole_).first(count));

  gl::UseClipFromPixel(current);
  current->Disable(GL_BLEND);
  current->Enable(GL_DEPTH_TEST);
  current->DepthMask(GL_TRUE);
  current->DepthFunc(GL_GREATER);
  // Seen from behind, a surface measured from the depth camera is none.
  current->Enable(GL_CULL_FACE);
  current->CullFace(GL_BACK);
  current->FrontFace(gl::ClockwiseInThePicture());
  o->vertex_array.Bind(current);
  o->grid.Use(current);
  o->grid.SetMatrix(current, "T_clip_pixel", gl::ClipFromPixel(width_, height_, near_m_).data());
  auto draw = [&](const gl::Framebuffer& to, const Cells& from, const std::array<int, 4>& corner_base,
                  int cell_base, int cells_a_row, int places_a_row, std::size_t cell_count) {
    to.Bind(current, width_, height_);
    to.ClearDepth(current, 0.0f);
    if (cell_count == 0) return;
    from.Bind(current, o->grid);
    for (std::size_t k = 0; k < 4; ++k) {
      const std::string name = "corner_base[" + std::to_string(k) + "]";
      o->grid.Set(current, name.c_str(), corner_base[k]);
    }
    o->grid.Set(current, "cell_base", cell_base);
    o->grid.Set(current, "cells_a_row", cells_a_row);
    o->grid.Set(current, "places_a_row", places_a_row);
    current->DrawArrays(GL_TRIANGLES, 0, static_cast<GLsizei>(6 * cell_count));
  };
  const int first = static_cast<int>(shape_.At(0, 0));
  const int stride = static_cast<int>(shape_.stride());
  const int across = std::max(0, shape_.width - 1);
  const int down = std::max(0, shape_.height - 1);
  draw(o->to_surface, surface, {first, first + 1, first + stride, first + stride + 1}, first,
       std::max(1, across), stride, static_cast<std::size_t>(across) * static_cast<std::size_t>(down));
  const int n = static_cast<int>(count);
  draw(o->to_torn, edges, {0, n, 2 * n, 3 * n}, 0, std::max(1, n), 0, count);

  o->to_depth_m.Bind(current, width_, height_);
  current->Disable(GL_DEPTH_TEST);
  current->Disable(GL_CULL_FACE);
  o->take_depth.Use(current);
  o->take_depth.Set(current, "surface", 0);
  o->take_depth.Set(current, "torn", 1);
  o->take_depth.Set(current, "metres_at_1", 0.5f * near_m_);
  o->surface.Bind(current, 0);
  o->torn.Bind(current, 1);
  current->DrawArrays(GL_TRIANGLES, 0, 3);

  const cv::Rect whole(0, 0, width_, height_);
  if (auto ok = o->read_back.Start(current, o->to_depth_m, 0, whole, GL_RED, GL_FLOAT, sizeof(float)); !ok)
    return ok;
  auto metres = o->read_back.Wait(current);
  if (!metres) return tl::unexpected(metres.error());
  const std::size_t row_bytes = static_cast<std::size_t>(width_) * sizeof(float);
  for (int y = 0; y < height_; ++y) {
    std::memcpy(depth_m.row(y), metres->data() + static_cast<std::size_t>(y) * row_bytes, row_bytes);
  }
  return {};
}

}  // namespace mixstage::depth
