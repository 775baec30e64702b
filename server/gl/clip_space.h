// SPDX-License-Identifier: Apache-2.0
//
// Where OpenCV's axes meet OpenGL's, the only place. Picture row 0 is the upper one and y points down; GL
// counts window rows from below. We let both rows 0 be the same row in memory: nothing is turned over on the
// way up or back, and what GL takes for "up" is the picture's down. What follows is that clockwise and
// counter-clockwise change places (FrontFaceOf), and that GL's z, which grows into the scene, is ours turned
// round to 1/z.
#pragma once

#include <Eigen/Core>

#include "server/gl/context.h"

namespace mixstage::gl {

// T_clip_pixel of a picture of width x height: (u, v, 1/z in 1/m, 1) to clip space of GL_ZERO_TO_ONE. Pixel
// centres are integers. 1/z is linear in the picture and so is its clip coordinate; near_m comes to 0.5, far
// away to 0, and depth tests are GL_GREATER: single precision then has its finest steps where 1/z has.
inline Eigen::Matrix4f ClipFromPixel(int width, int height, float near_m) {
  Eigen::Matrix4f T_clip_pixel = Eigen::Matrix4f::Zero();
  T_clip_pixel(0, 0) = 2.0f / static_cast<float>(width);
  T_clip_pixel(0, 3) = 1.0f / static_cast<float>(width) - 1.0f;
  T_clip_pixel(1, 1) = 2.0f / static_cast<float>(height);
  T_clip_pixel(1, 3) = 1.0f / static_cast<float>(height) - 1.0f;
  T_clip_pixel(2, 2) = 0.5f * near_m;
  T_clip_pixel(3, 3) = 1.0f;
  return T_clip_pixel;
}

// The state that ClipFromPixel counts on.
inline void UseClipFromPixel(const Current& current) { current->ClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE); }

// Triangles that run counter-clockwise for who looks at the picture.
inline GLenum CounterClockwiseInThePicture() { return GL_CW; }
inline GLenum ClockwiseInThePicture() { return GL_CCW; }

}  // namespace mixstage::gl
