// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>

#include "server/gl/texture.h"

namespace mixstage::gl {

// What a pass draws into. The textures must outlive it.
class Framebuffer {
 public:
  // colors[i] is what the fragment shader's output i goes to; depth may be null.
  static Result<Framebuffer> Create(const Current& current, std::initializer_list<const Texture*> colors,
                                    const Texture* depth);
  // Draws go here, to the corner of width x height pixels.
  void Bind(const Current& current, int width, int height) const;
  void ClearColor(const Current& current, int attachment, float value) const;
  void ClearColor(const Current& current, int attachment, int value) const;
  void ClearDepth(const Current& current, float value) const;
  [[nodiscard]] GLuint id() const { return name_.id(); }

 private:
  explicit Framebuffer(Name name) : name_(std::move(name)) {}
  Name name_;
};

}  // namespace mixstage::gl
