// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "server/depth/depth_grid.h"
#include "server/depth/grid_scan.h"
#include "server/gl/buffer.h"
#include "server/gl/framebuffer.h"
#include "server/gl/gpu.h"
#include "server/gl/program.h"
#include "server/gl/read_back.h"
#include "server/gl/texture.h"
#include "server/gl/vertex_array.h"

namespace mixstage::depth {

// The grid's way on a GPU: what ScanCells, EraseBehindCells and TakeDepth do, in one call and from the same
// corners.
class EglGridScan {
 public:
  // width, height: of the colour picture. Fails when the GPU cannot run the pass.
  static Result<EglGridScan> Create(std::shared_ptr<gl::Gpu> gpu, const GridShape& shape, int width,
                                    int height, float near_m);

  // corners, cells: of the whole grid (GridShape::At); torn[k]: corner k of the torn cells, the first `count`
  // of each. depth_m [color h x w] out: metres, 0 = unknown. Fails (kUnavailable) when the GPU's context is
  // lost; depth_m is then not touched.
  Status Draw(const GridCorners& corners, std::span<const std::uint8_t> cells, const GridCorners (&torn)[4],
              std::size_t count, ImageView<float> depth_m);

 private:
  struct Cells {
    gl::BufferTexture x, y, outcode, inverse_z, cells;
    static Cells Create(const gl::Current& current);
    void Bind(const gl::Current& current, const gl::Program& program) const;
  };
  struct Objects {
    gl::Program grid, take_depth;
    gl::VertexArray vertex_array;
    Cells surface_cells, torn_cells;
    gl::Texture surface, torn, depth_m;
    gl::Framebuffer to_surface, to_torn, to_depth_m;
    gl::ReadBack read_back;
  };
  EglGridScan(std::shared_ptr<gl::Gpu> gpu, const GridShape& shape, int width, int height, float near_m)
      : gpu_(std::move(gpu)), shape_(shape), width_(width), height_(height), near_m_(near_m) {}
  [[nodiscard]] Result<Objects> Make(const gl::Current& current) const;
  Status DrawOn(const gl::Current& current, const GridCorners& corners, std::span<const std::uint8_t> cells,
                const GridCorners (&torn)[4], std::size_t count, ImageView<float> depth_m);

  std::shared_ptr<gl::Gpu> gpu_;
  GridShape shape_;
  int width_ = 0, height_ = 0;
  float near_m_ = 0;
  gl::PerContext<Objects> objects_;
  std::vector<std::uint8_t> whole_;  // cells of the torn ones
};

}  // namespace mixstage::depth
