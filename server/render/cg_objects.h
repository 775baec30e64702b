// SPDX-License-Identifier: Apache-2.0
//
// The first half of a redraw: the scene's objects brought into the camera's frame and drawn into a visibility
// buffer of four samples a pixel.
#pragma once

#include <map>
#include <vector>

#include "proto/geometry/frames.h"
#include "server/raster/rasteriser.h"
#include "server/render/prepared_mesh.h"
#include "server/scene/scene.h"

namespace mixstage {

inline constexpr int kSampleScale = 2;  // samples a pixel and direction

// A corner in the camera's frame, laid out for two vector loads from one cache line.
struct alignas(32) CameraVertex {
  Eigen::Array4f position_u;  // x, y, z, u
  Eigen::Array4f normal_v;    // of any length > 0; v
};

struct CameraObject {
  const PreparedMesh* mesh = nullptr;
  std::size_t first_vertex = 0;    // into CameraScene::vertices
  std::size_t first_triangle = 0;  // id of its first triangle in the visibility buffer
  int index = 0;                   // in the scene
  bool mirrored = false;
};

class CameraScene {
 public:
  explicit CameraScene(std::shared_ptr<PreparedMeshes> meshes) : meshes_(std::move(meshes)) {}

  // Meshes are prepared when first seen and dropped when the scene no longer holds them.
  void Place(const Scene& scene, const RigidTransform& T_camera_scene);

  // Picture pixels that the objects may touch, even-aligned; empty when none is in view.
  [[nodiscard]] cv::Rect Region(const PinholeCamera& camera, double near_m) const;

  void Draw(const Scene& scene, const RigidTransform& T_camera_scene, Rasteriser& rasteriser) const;

  // The object whose triangle this id is.
  [[nodiscard]] const CameraObject& ObjectOf(std::size_t triangle) const;

  [[nodiscard]] const std::vector<CameraObject>& objects() const { return objects_; }
  [[nodiscard]] const std::vector<CameraVertex>& vertices() const { return vertices_; }

 private:
  std::shared_ptr<PreparedMeshes> meshes_;
  std::map<const Mesh*, std::shared_ptr<const PreparedMesh>> prepared_;
  std::vector<CameraObject> objects_;
  std::vector<CameraVertex> vertices_;
};

}  // namespace mixstage
