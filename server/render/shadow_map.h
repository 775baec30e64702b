// SPDX-License-Identifier: Apache-2.0
//
// What one point of a lamp sees: up to six square pictures of depth, a cube's faces, of which only those are
// kept that casters fall on; a directional light has one, over the casters (MixIn3D 3.2's shadow maps).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <memory>
#include <opencv2/core.hpp>
#include <span>

#include "server/raster/rasteriser.h"
#include "server/render/lamp_samples.h"
#include "server/render/shadow_lookup.h"

namespace mixstage {

// What casts shadows, borrowed for the drawing.
struct ShadowCaster {
  TriangleMeshView mesh;
  Eigen::Affine3d T_scene_mesh = Eigen::Affine3d::Identity();
  Eigen::Vector3f center = Eigen::Vector3f::Zero();  // of a sphere around it, scene frame
  float radius_m = 0;
};

// Draws the faces; one for all maps. One thread at a time.
class ShadowRasteriser {
 public:
  static constexpr int kFacePx = 512;
  static constexpr double kNear_m = 0.1;  // a lamp's own case casts no shadow
  ShadowRasteriser();
  Rasteriser& operator*() { return *rasteriser_; }

 private:
  std::unique_ptr<Rasteriser> rasteriser_;
};

class ShadowMap {
 public:
  // Nothing casts a shadow.
  ShadowMap() = default;
  // Draws anew, in the scene's frame.
  void Draw(const LampSample& lamp, std::span<const ShadowCaster> casters, ShadowRasteriser& rasteriser);
  void Clear();
  [[nodiscard]] bool empty() const { return faces_in_use_ == 0; }

  // Whether any point of a sphere may be hidden from the lamp.
  [[nodiscard]] bool MayHide(const Eigen::Vector3f& center, float radius_m) const;
  // Share 0..1 of the light that reaches each of the points: the four pixels around it, each lit or not,
  // blended. What stands nearer to a point than bias_m casts nothing on it.
  void Lit(const PointRun& points, float bias_m, LitRun& lit) const;

 private:
  struct Face {
    bool in_use = false;
    Eigen::Matrix3f R_face_scene = Eigen::Matrix3f::Identity();
    float focal_px = 0;
    cv::Rect box;       // of the face's pixels, a margin of one pixel of nothing around them included
    cv::Mat1f depth_m;  // [box]; "nothing" is far away
    float nearest_m = 0;
  };
  void DrawFace(std::size_t number, const Eigen::Matrix3f& R_face_scene, float focal_px,
                std::span<const ShadowCaster> casters, ShadowRasteriser& rasteriser);

  Eigen::Vector3f position_ = Eigen::Vector3f::Zero();
  bool directional_ = false;
  std::array<Face, 6> faces_;
  int faces_in_use_ = 0;
};

}  // namespace mixstage
