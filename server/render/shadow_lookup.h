// SPDX-License-Identifier: Apache-2.0
//
// The vector kernel behind ShadowMap::Lit: many points looked up in one face at once.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace mixstage {

// Points, a number a row, with room for a last vector.
struct PointRun {
  static constexpr std::size_t kMost = 256;
  alignas(64) std::array<float, kMost> x{}, y{}, z{};
  std::size_t count = 0;

  void Add(const Eigen::Vector3f& p) {
    x[count] = p.x();
    y[count] = p.y();
    z[count] = p.z();
    ++count;
  }
};
// A number of each.
struct alignas(64) LitRun : std::array<float, PointRun::kMost> {};

// A face of a ShadowMap, to be read.
struct ShadowFaceView {
  int number = -1;  // of a cube's faces: looks along axis number / 2, to its negative side if odd; -1: of all
  std::array<float, 3> position{};      // of the lamp
  std::array<float, 9> R_face_scene{};  // by rows
  float focal_px = 0;
  std::array<float, 2> center_px{};  // in the picture of depth
  int width = 0, height = 0, stride = 0;
  const float* depth_m = nullptr;
};

// Of every point that lies on the face: the four pixels around it, each lit or not, blended. What stands
// nearer than bias_m to it casts nothing on it. The others keep their number.
void LookUpShadow(const ShadowFaceView& face, const PointRun& points, float bias_m, LitRun& lit);

}  // namespace mixstage
