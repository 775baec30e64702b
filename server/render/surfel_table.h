// SPDX-License-Identifier: Apache-2.0
//
// How much of the ambient light the surfels of a scene's objects hide from a point (MixIn3D 3.2).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "server/render/shadow_shapes.h"

namespace mixstage {

// Surfels number by number, so that one point looks at many at once.
class SurfelTable {
 public:
  struct Range {
    std::size_t begin = 0, end = 0;
  };

  void Clear();
  void Add(const Surfel& surfel);
  // What was added since the range before, which it follows.
  Range Close();

  // 0..: the sum of the form factors of those that face the point; right for a convex object above the
  // horizon. normal has length 1.
  [[nodiscard]] float Hidden(const Range& range, const Eigen::Vector3f& position,
                             const Eigen::Vector3f& normal) const;

 private:
  // Center x y z, facing x y z, area.
  std::array<std::vector<float>, 7> numbers_;
  std::size_t closed_ = 0;
};

}  // namespace mixstage
