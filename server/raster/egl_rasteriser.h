// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "server/gl/buffer.h"
#include "server/gl/framebuffer.h"
#include "server/gl/gpu.h"
#include "server/gl/program.h"
#include "server/gl/read_back.h"
#include "server/gl/texture.h"
#include "server/gl/vertex_array.h"
#include "server/raster/raster_lens.h"
#include "server/raster/rasteriser.h"
#include "server/raster/scan_picture.h"
#include "server/raster/split_triangle.h"

namespace mixstage::raster {

// The back end on a GPU. Corners go through the lens and long edges are split as in CpuRasteriser, by the
// same code, so that both draw the same triangles; those are recorded and, in Finish, scanned by the GPU. A
// picture that the GPU cannot give (its context is lost, its memory full) is scanned here from the same
// record: none is missing, the next one tries the GPU again.
//
// The owner may change threads between Finish and Begin.
class EglRasteriser final : public Rasteriser {
 public:
  // Camera and config are checked by CreateRasteriser. Fails when the GPU cannot run the pass.
  static Result<EglRasteriser> Create(const PinholeCamera& camera, const RasterConfig& config,
                                      std::shared_ptr<gl::Gpu> gpu);

  void Begin(const PictureGrid& grid) override;
  void Draw(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
            Faces faces) override;
  void DrawDepth(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, Faces faces) override;
  const VisibilityBuffer& Finish() override;

  // What Finish gives, left where it was drawn: [at least grid h x w] GL_R32I, ids; row 0 is the upper one.
  // Until the next Begin. Null when the GPU cannot give the picture: Finish still can.
  const gl::Texture* FinishOnGpu(const gl::Current& current);
  [[nodiscard]] cv::Rect touched() const { return RectOf(touched_); }

 private:
  // Triangles of one Draw, or the parts that its long ones were split into.
  struct Batch {
    std::size_t first_vertex = 0, vertices = 0;
    std::size_t first_index = 0, indices = 0;
    std::ptrdiff_t first_listed = -1;  // into ids_; -1: ids count up from first_id
    int first_id = 0;
    Faces faces = Faces::kBoth;
    bool mirrored = false;
    bool with_ids = true;
  };
  // As large as the largest grid so far.
  struct Targets {
    gl::Texture depth_m, triangle, depth;
    gl::Framebuffer framebuffer;
    static Result<Targets> Create(const gl::Current& current, int width, int height);
  };
  struct Objects {
    gl::Program scan;
    gl::VertexArray vertex_array;
    gl::Buffer vertices, indices;
    gl::BufferTexture ids;
    gl::ReadBack depth_m, triangle;
    std::optional<Targets> targets;
    static Result<Objects> Create(const gl::Current& current);
  };

  EglRasteriser(const PinholeCamera& camera, const RasterConfig& config, std::shared_ptr<gl::Gpu> gpu);
  void Record(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, Batch batch);
  void RecordSplit(const Batch& like);
  Status Scan(const gl::Current& current);
  Status ScanAndRead(const gl::Current& current);
  void ScanHere(const Batch& batch, std::span<const ProjectedVertex> vertices,
                std::span<const std::uint32_t> indices, std::span<const std::int32_t> ids);
  void Report(const Error& error);

  const PinholeCamera camera_;
  const RasterLens picture_lens_;
  const std::shared_ptr<gl::Gpu> gpu_;
  gl::PerContext<Objects> objects_;
  RasterLens lens_;  // on the grid
  ScanTarget clip_;
  ScanPicture picture_;
  enum class Stage { kRecording = 1, kFinished } stage_ = Stage::kFinished;
  bool partly_here_ = false;  // some of this picture has been scanned into picture_
  bool reported_ = false;
  // The record.
  std::vector<Batch> batches_;
  std::vector<ProjectedVertex> vertices_;
  std::vector<std::uint32_t> indices_;  // relative to their batch's first vertex
  std::vector<std::int32_t> ids_;
  TouchedBox touched_;
  // Scratch, kept for its memory.
  std::vector<std::uint32_t> needs_split_, never_split_;
  SplitTriangles split_;
};

}  // namespace mixstage::raster
