// SPDX-License-Identifier: Apache-2.0
//
// The fragments of one picture row as the vector kernels read and write them: an array a number. A fragment
// is one surface in one pixel. Camera frame, metres.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mixstage {

class FragmentRows {
 public:
  enum Row {
    // Set by whoever collects the fragments.
    kRayX,
    kRayY,   // (x/z, y/z) of where it is shaded
    kFront,  // +1: the corners run counter-clockwise seen from the front; -1: mirrored object
    kTextureWidth,
    kTextureHeight,  // texels of level 0; 0 = no texture
    kShininess,      // Blinn-Phong's exponent, >= 1
    kShare,          // of the pixel's samples
    // By Interpolate.
    kX,
    kY,
    kZ,  // position
    kNx,
    kNy,
    kNz,  // normal toward the viewer's side; of length 1 after ShadeLights
    kU,
    kV,  // texture coordinates
    kStepU,
    kStepV,         // ... along the longer axis of the pixel's footprint, whole pixel
    kTaps,          // samples to take along it: 1..4
    kTexelsPerTap,  // level 0 texels that one of them stands for
    kWeight1,
    kWeight2,  // of the second and third corner
    // By ShadeLights.
    kDiffuseR,
    kDiffuseG,
    kDiffuseB,  // irradiance / pi
    kSpecularR,
    kSpecularG,
    kSpecularB,  // what a perfect mirror coating would show
    kRowCount
  };
  static constexpr std::size_t kPadding = 64;  // elements after the last fragment that kernels may overwrite

  // Room for count fragments; what was there is lost when it grows.
  void Resize(std::size_t count) {
    if (count <= capacity_) return;
    capacity_ = (count + kPadding - 1) / kPadding * kPadding;
    stride_ = capacity_ + kPadding;
    data_.assign(kRowCount * stride_, 0.0f);
    corners_.assign(6 * 4 * stride_, 0.0f);
  }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }
  [[nodiscard]] float* row(Row r) { return data_.data() + static_cast<std::size_t>(r) * stride_; }
  [[nodiscard]] const float* row(Row r) const { return data_.data() + static_cast<std::size_t>(r) * stride_; }

  // Four numbers a fragment of corner 0..2: (x, y, z, u) in block 0..2, (normal, v) in block 3..5.
  [[nodiscard]] float* corner(std::size_t block) { return corners_.data() + block * 4 * stride_; }
  [[nodiscard]] const float* corner(std::size_t block) const { return corners_.data() + block * 4 * stride_; }

 private:
  std::vector<float> data_, corners_;
  std::size_t capacity_ = 0, stride_ = 0;
};

}  // namespace mixstage
