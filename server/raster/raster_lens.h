// SPDX-License-Identifier: Apache-2.0
//
// A pinhole camera with its distortion, in single precision, as the rasteriser needs it.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <span>

#include "proto/geometry/camera_model.h"
#include "server/raster/projected_vertex.h"

namespace mixstage::raster {

struct Affine34;

// Single precision keeps projections within 1e-3 px of PinholeCamera's up to 8192 px.
struct RasterLens {
  float fx = 0, fy = 0, cx = 0, cy = 0;  // grid pixels
  float k1 = 0, k2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0, p1 = 0, p2 = 0;
  float fold_r2 = 0;  // square of the largest undistorted radius that has a pixel
  float near_m = 0;
  // (x/z, y/z) of everything the picture can see lies inside.
  float view_x0 = 0, view_x1 = 0, view_y0 = 0, view_y1 = 0;
  // Edges longer than this in x or y (sub-pixels) leave their curve by more than 0.05 picture px, or do not
  // fit the scan: they are split.
  std::int32_t max_edge = kMaxEdgePx * kSubPixels;
  Eigen::Vector4f half_space = Eigen::Vector4f::Zero();  // PictureGrid's

  // The costly part (the fold, the view's outline, the curvature) is done once per camera ...
  static RasterLens Of(const PinholeCamera& picture, double near_m);
  // ... and carried over to a grid of it: camera is the grid's (PictureGrid::CameraOf).
  [[nodiscard]] RasterLens OnGrid(const PinholeCamera& camera, int scale) const;
  // Adds kCutOff.
  void CutOff(const Affine34& T_camera_object, std::span<const Eigen::Vector3f> positions,
              std::span<ProjectedVertex> projected) const;

  [[nodiscard]] bool cuts() const { return half_space.head<3>() != Eigen::Vector3f::Zero(); }
  // Over the half space's border, metres.
  [[nodiscard]] float Height(const Eigen::Vector3f& p_camera) const {
    return half_space.head<3>().dot(p_camera) + half_space.w();
  }
  // Point of the camera frame to its pixel, all but kCutOff. The vector code does the same operations in the
  // same order.
  [[nodiscard]] ProjectedVertex Project(const Eigen::Vector3f& p_camera) const;
};

// Rows of a 3 x 4 affine transform.
struct Affine34 {
  float m[3][4] = {};
  static Affine34 Of(const Eigen::Affine3d& T);
  [[nodiscard]] Eigen::Vector3f operator*(const Eigen::Vector3f& p) const {
    return {m[0][0] * p.x() + m[0][1] * p.y() + m[0][2] * p.z() + m[0][3],
            m[1][0] * p.x() + m[1][1] * p.y() + m[1][2] * p.z() + m[1][3],
            m[2][0] * p.x() + m[2][1] * p.y() + m[2][2] * p.z() + m[2][3]};
  }
};

// out[i] = lens.Project(T_camera_object * positions[i]); sizes equal.
void ProjectVertices(const RasterLens& lens, const Affine34& T_camera_object,
                     std::span<const Eigen::Vector3f> positions, std::span<ProjectedVertex> out);
void ProjectVerticesScalar(const RasterLens& lens, const Affine34& T_camera_object,
                           std::span<const Eigen::Vector3f> positions, std::span<ProjectedVertex> out);

}  // namespace mixstage::raster
