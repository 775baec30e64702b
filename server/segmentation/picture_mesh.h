// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace mixstage {

// What the colour camera sees of a surface, as triangles that its picture is laid on.
struct PictureMesh {
  std::vector<Eigen::Vector3f> positions;  // scene frame, metres
  std::vector<Eigen::Vector2f> uvs;        // 0..1 in `crop`, v down; as many as positions
  std::vector<std::uint32_t> indices;      // three a triangle, counter-clockwise seen from the camera
  cv::Rect crop;                           // of the colour picture: what belongs on the surface, px

  [[nodiscard]] bool empty() const { return indices.empty(); }
};

}  // namespace mixstage
