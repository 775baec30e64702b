// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "server/gl/context.h"

namespace mixstage::gl {

// A picture on the GPU, one level. Row 0 is the picture's upper row everywhere (clip_space.h says why nothing
// is ever turned upside down).
class Texture {
 public:
  // format is a sized one: GL_R32F, GL_R32I, GL_DEPTH_COMPONENT32F ... Fails (kBadInput) beyond the GPU's
  // largest side, (kInternal) when its memory is full.
  static Result<Texture> Create(const Current& current, GLenum format, int width, int height);

  // The whole picture; rows are contiguous. layout, type: what values are (GL_RG, GL_FLOAT).
  template <typename T>
  void Write(const Current& current, GLenum layout, GLenum type, std::span<const T> values) const {
    WriteBytes(current, layout, type, values.data());
  }
  void Bind(const Current& current, GLuint unit) const;

  [[nodiscard]] GLuint id() const { return name_.id(); }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

 private:
  Texture(Name name, int width, int height) : name_(std::move(name)), width_(width), height_(height) {}
  void WriteBytes(const Current& current, GLenum layout, GLenum type, const void* data) const;
  Name name_;
  int width_ = 0, height_ = 0;
};

}  // namespace mixstage::gl
