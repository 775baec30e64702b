// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/gl/buffer.h"

namespace mixstage::gl {

// Where a draw's vertices come from. Without buffers: shaders that fetch by gl_VertexID.
class VertexArray {
 public:
  static VertexArray Create(const Current& current) {
    GLuint id = 0;
    current->CreateVertexArrays(1, &id);
    return VertexArray(Name(current, Name::Kind::kVertexArray, id));
  }
  // Vertices of `stride` bytes; attributes are then laid out with Float and Integer.
  void SetVertices(const Current& current, const Buffer& buffer, int stride) const {
    current->VertexArrayVertexBuffer(name_.id(), 0, buffer.id(), 0, stride);
  }
  void SetIndices(const Current& current, const Buffer& buffer) const {
    current->VertexArrayElementBuffer(name_.id(), buffer.id());
  }
  void Float(const Current& current, GLuint location, int size, GLuint offset) const {
    current->VertexArrayAttribFormat(name_.id(), location, size, GL_FLOAT, GL_FALSE, offset);
    Enable(current, location);
  }
  void Integer(const Current& current, GLuint location, int size, GLuint offset) const {
    current->VertexArrayAttribIFormat(name_.id(), location, size, GL_INT, offset);
    Enable(current, location);
  }
  void Bind(const Current& current) const { current->BindVertexArray(name_.id()); }

 private:
  explicit VertexArray(Name name) : name_(std::move(name)) {}
  void Enable(const Current& current, GLuint location) const {
    current->VertexArrayAttribBinding(name_.id(), location, 0);
    current->EnableVertexArrayAttrib(name_.id(), location);
  }
  Name name_;
};

}  // namespace mixstage::gl
