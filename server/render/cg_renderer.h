// SPDX-License-Identifier: Apache-2.0
//
// The computer-generated layer: the scene's objects in the colour camera's own distorted view, shaded in
// linear light and antialiased by coverage, with the depth that the z-key needs (piVE sections 4, 5;
// MixIn3D 3.1).
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>

#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/raster/render_device.h"
#include "server/render/illumination.h"
#include "server/render/prepared_mesh.h"
#include "server/scene/scene.h"

namespace mixstage {

struct CgLayer {
  // Picture pixels that hold CG; even x, y and, but at the picture's own right and lower edge, even sizes.
  // Empty: nothing of the scene is in view. The pictures below have its size.
  cv::Rect bounds;
  cv::Mat4f
      color;  // R G B in linear light (1.0 = the picture's white), times coverage; fourth: coverage 0..1
  cv::Mat1f depth_m;    // z of the nearest surface in the pixel; 0 = nothing
  cv::Mat1b object_id;  // 1 + index of that surface's object in the scene (255: that and all later ones); 0 =
                        // nothing
  std::uint64_t drawing = 0;  // rises with every redraw: equal numbers, equal layers
};

struct CgRendererConfig {
  double near_m = 0.05;  // objects nearer to the camera are cut there
};

// The part of a scene that is drawn.
struct CgPart {
  cv::Rect window_px;  // of the picture, even-aligned as bounds; empty = all of it
  // Half space of the scene's frame, n . p + d >= 0; zero: everything.
  Eigen::Vector4d half_space = Eigen::Vector4d::Zero();
  bool operator==(const CgPart&) const = default;
};

// Wall time of the last redraw.
struct CgTiming {
  double visibility_ms = 0;  // vertices, raster
  double shading_ms = 0;
};

// One thread at a time. Memory grows to the largest scene drawn, then stays.
class CgRenderer {
 public:
  // device: what visibility and shading are drawn with; the layers are the same but for roundings. Fails
  // (kInvalidConfig) when the camera or near_m is not valid, (kInternal) when a GPU cannot run the passes.
  // meshes: shared with others who draw the same scene; null = its own.
  static Result<CgRenderer> Create(const CgRendererConfig& config, const PinholeCamera& color,
                                   const RenderDevice& device = {},
                                   std::shared_ptr<PreparedMeshes> meshes = nullptr);
  CgRenderer(CgRenderer&&) noexcept;
  CgRenderer& operator=(CgRenderer&&) noexcept;
  ~CgRenderer();

  // T_camera_scene: T_camera_world for a world scene, T_camera_firstcamera (identity at rest) for a camera
  // scene. The layer stays as it is, at no cost, while scene, pose, light and part are those of the last
  // call; it is valid until the next call.
  const CgLayer& Run(const Scene& scene, const RigidTransform& T_camera_scene, const Illumination& light,
                     const CgPart& part = {});

  [[nodiscard]] const CgTiming& timing() const;

 private:
  struct State;
  explicit CgRenderer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace mixstage
