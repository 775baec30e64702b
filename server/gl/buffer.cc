// SPDX-License-Identifier: Apache-2.0
#include "server/gl/buffer.h"

namespace mixstage::gl {

Buffer Buffer::Create(const Current& current) {
  GLuint id = 0;
  current->CreateBuffers(1, &id);
  return Buffer(Name(current, Name::Kind::kBuffer, id));
}

void Buffer::Resize(const Current& current, std::size_t bytes) const {
  // Never empty: a texture over a buffer without memory is incomplete.
  current->NamedBufferData(id(), static_cast<GLsizeiptr>(bytes == 0 ? 16 : bytes), nullptr, GL_STREAM_DRAW);
}

void Buffer::FillBytes(const Current& current, std::size_t first_byte, const void* data,
                       std::size_t bytes) const {
  if (bytes == 0) return;
  current->NamedBufferSubData(id(), static_cast<GLintptr>(first_byte), static_cast<GLsizeiptr>(bytes), data);
}

BufferTexture BufferTexture::Create(const Current& current, GLenum format) {
  Buffer buffer = Buffer::Create(current);
  buffer.Resize(current, 0);
  GLuint id = 0;
  current->CreateTextures(GL_TEXTURE_BUFFER, 1, &id);
  Name texture(current, Name::Kind::kTexture, id);
  current->TextureBuffer(id, format, buffer.id());
  return {std::move(buffer), std::move(texture)};
}

Status BufferTexture::CheckSize(const Current& current, std::size_t texels) const {
  const auto most = static_cast<std::size_t>(current.info().max_buffer_texels);
  if (texels <= most) return {};
  return Fail(ErrorCode::kBadInput, "a scene of " + std::to_string(texels) +
                                        " elements where the GPU can address " + std::to_string(most));
}

void BufferTexture::Bind(const Current& current, GLuint unit) const {
  current->BindTextureUnit(unit, texture_.id());
}

}  // namespace mixstage::gl
