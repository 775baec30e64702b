// SPDX-License-Identifier: Apache-2.0
//
// The view into a mirror (MixIn3D 3.3; algorithms 10): what the colour camera sees in a plane is what the
// camera reflected at that plane sees past it. Its picture is turned left-right, which makes the reflected
// camera one like any other: nothing in the scene is mirrored, triangles keep their fronts.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/scene/scene.h"

namespace mixstage {

// Of half the size, its pixel (x, y) seen in the colour camera's 2x2 pixels from (2 (width - 1 - x), 2 y) on.
[[nodiscard]] PinholeCamera MirroredCamera(const PinholeCamera& color);

// How a reflector stands before the camera.
struct MirrorView {
  Eigen::Vector4d plane = Eigen::Vector4d::Zero();  // scene frame; the camera is on its positive side
  RigidTransform T_scene_mirrored = RigidTransform::Identity();  // MirroredCamera's
};
// Nothing where the camera is in the plane or less than a centimetre from it.
[[nodiscard]] std::optional<MirrorView> ViewInto(const Reflector& reflector,
                                                 const RigidTransform& T_scene_color);

// Pixels of the colour camera's half-size picture that the reflector's polygon may cover; all of them where
// it has none. Empty: it is not in view.
[[nodiscard]] cv::Rect WindowOf(const Reflector& reflector, const RigidTransform& T_scene_color,
                                const PinholeCamera& color);

// Whether a point of the plane lies in the reflector's polygon.
class PolygonTest {
 public:
  explicit PolygonTest(const Reflector& reflector);
  [[nodiscard]] bool Contains(const Eigen::Vector3f& point) const;

 private:
  int first_ = 0, second_ = 1;  // the axes that the plane is seen along the third of
  std::vector<Eigen::Vector2f> corners_;
};

// Share of the light that a surface mirrors, seen at that cosine to its normal: Schlick's form of Fresnel's
// equations from the share head-on; a rough surface never comes to a whole mirror (Lagarde 2011).
[[nodiscard]] float Fresnel(double reflectivity, double roughness, float cosine);

}  // namespace mixstage
