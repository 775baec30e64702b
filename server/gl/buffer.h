// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

#include "server/gl/context.h"

namespace mixstage::gl {

// Memory of the GPU that is written from here, whole, as often as once a picture.
class Buffer {
 public:
  static Buffer Create(const Current& current);

  // Replaces all of it; what was drawn before still sees the old content. Errors show in Current::Check.
  template <typename T>
  void Write(const Current& current, std::span<const T> values) const {
    Resize(current, values.size_bytes());
    Fill(current, 0, values);
  }
  // The same in pieces: room first, then what stands where.
  void Resize(const Current& current, std::size_t bytes) const;
  template <typename T>
  void Fill(const Current& current, std::size_t first_byte, std::span<const T> values) const {
    FillBytes(current, first_byte, values.data(), values.size_bytes());
  }
  [[nodiscard]] GLuint id() const { return name_.id(); }

 private:
  explicit Buffer(Name name) : name_(std::move(name)) {}
  void FillBytes(const Current& current, std::size_t first_byte, const void* data, std::size_t bytes) const;
  Name name_;
};

// A buffer that shaders read by index, as texels of one format (samplerBuffer and its kin).
class BufferTexture {
 public:
  static BufferTexture Create(const Current& current, GLenum format);
  // Fails (kBadInput) when there are more texels than the GPU can address.
  template <typename T>
  Status Write(const Current& current, std::span<const T> values, std::size_t texels) const {
    if (auto ok = CheckSize(current, texels); !ok) return ok;
    buffer_.Write(current, values);
    return {};
  }
  [[nodiscard]] Status CheckSize(const Current& current, std::size_t texels) const;
  [[nodiscard]] const Buffer& buffer() const { return buffer_; }
  void Bind(const Current& current, GLuint unit) const;

 private:
  BufferTexture(Buffer buffer, Name texture) : buffer_(std::move(buffer)), texture_(std::move(texture)) {}
  Buffer buffer_;
  Name texture_;
};

}  // namespace mixstage::gl
