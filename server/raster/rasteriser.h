// SPDX-License-Identifier: Apache-2.0
//
// Triangles to depth and triangle id through a real (distorting) lens: what the room, CG objects and shadow
// maps are drawn with. One interface; a back end decides nothing but speed.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <span>

#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"

namespace mixstage {

namespace gl {
class Gpu;
}

enum class RasterBackend {
  kCpu = 1,  // this processor's vectors, one thread
  kEgl,      // OpenGL 4.5 through EGL: a GPU, or a software driver of it
};

enum class Faces {
  kBoth = 1,   // triangles are seen from both sides
  kFrontOnly,  // only where their corners run counter-clockwise (glTF's outside); half the work on closed
               // bodies
};

// The grid a picture is drawn on: `scale` x `scale` grid pixels for every picture pixel inside `region_px`.
// Picture pixel u covers the grid pixels scale (u - region_px.x) + k, k = 0..scale-1; with pixel centres at
// integers their centres lie at u + (k + 0.5) / scale - 0.5 in the picture. scale > 1 is for coverage
// antialiasing.
struct PictureGrid {
  int scale = 1;       // 1, 2 or 4
  cv::Rect region_px;  // inside the picture; empty = all of it
  // Half space of the camera's frame that is drawn, n . p + d >= 0: what it leaves out is cut off. Zero:
  // everything is drawn.
  Eigen::Vector4f half_space = Eigen::Vector4f::Zero();

  // The camera whose pixels are the grid's (a region that is empty stands for the whole picture).
  [[nodiscard]] PinholeCamera CameraOf(const PinholeCamera& picture) const;
};

// What is visible at every grid pixel. Rows are not contiguous: use View() or ptr().
struct VisibilityBuffer {
  cv::Mat1f depth_m;   // [h x w] z along the camera's axis; 0 = nothing
  cv::Mat1i triangle;  // [h x w] first_id + number of the nearest triangle; -1 = nothing
  cv::Rect touched;    // everything outside it is "nothing"
};

// A model's triangles, borrowed for the call: corners are positions[indices[3 i + 0..2]].
struct TriangleMeshView {
  std::span<const Eigen::Vector3f> positions;  // metres, object frame
  std::span<const std::uint32_t> indices;      // a multiple of 3, each < positions.size() (checked: our bug)
  void Check() const;
};

struct RasterConfig {
  double near_m = 0.05;  // nothing nearer is drawn; triangles that cross it are cut there
};

// Use: Begin, any number of Draws that accumulate, Finish; then again. One thread owns a rasteriser; memory
// grows to the largest grid and mesh seen and then stays.
//
// Pixels belong to triangles by their centres under the top-left rule with corners rounded to 1/256 pixel:
// pixels on a shared edge belong to exactly one triangle. Only corners go through the lens, so triangles are
// split until the chord of an edge stays within 0.05 px of its curve (algorithms 13). 1/z is linear inside
// one. Equal depth: the first drawn stays. Triangles with a corner that is not finite, or beyond the angle
// where the lens folds back, are not drawn (those across the fold are drawn up to it).
//
// Back ends agree but where a triangle's edge runs through a pixel's centre: corners are the same to the bit,
// of the fill rule GL only promises that such a pixel belongs to one triangle.
class Rasteriser {
 public:
  virtual ~Rasteriser() = default;
  // Empties the buffer; the cost is that of what the last use touched.
  virtual void Begin(const PictureGrid& grid) = 0;
  // T_camera_object may scale and mirror. Triangle i gets first_id + i; ids must be >= 0.
  virtual void Draw(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
                    Faces faces) = 0;
  // Same without ids (shadow maps: depth alone is wanted): what it covers keeps id -1.
  virtual void DrawDepth(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object,
                         Faces faces) = 0;
  // Valid until the next Begin.
  virtual const VisibilityBuffer& Finish() = 0;
};

// Fails (kInvalidConfig, the field named) when the camera is not valid or near_m is not in 1e-4..10, with
// kEgl also (kUnavailable) without EGL. gpu: what kEgl draws with; null = one of its own.
Result<std::unique_ptr<Rasteriser>> CreateRasteriser(RasterBackend backend, const PinholeCamera& camera,
                                                     const RasterConfig& config,
                                                     std::shared_ptr<gl::Gpu> gpu = nullptr);

}  // namespace mixstage
