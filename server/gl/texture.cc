// SPDX-License-Identifier: Apache-2.0
#include "server/gl/texture.h"

namespace mixstage::gl {

Result<Texture> Texture::Create(const Current& current, GLenum format, int width, int height) {
  const int most = current.info().max_side_px;
  if (width < 1 || height < 1 || width > most || height > most) {
    return Fail(ErrorCode::kBadInput, "a picture of " + std::to_string(width) + "x" + std::to_string(height) +
                                          " px where the GPU draws up to " + std::to_string(most));
  }
  GLuint id = 0;
  current->CreateTextures(GL_TEXTURE_2D, 1, &id);
  Texture texture(Name(current, Name::Kind::kTexture, id), width, height);
  current->TextureStorage2D(id, 1, format, width, height);
  current->TextureParameteri(id, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  current->TextureParameteri(id, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  if (auto ok = current.Check("texture"); !ok) return tl::unexpected(ok.error());
  return texture;
}

void Texture::WriteBytes(const Current& current, GLenum layout, GLenum type, const void* data) const {
  current->BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  current->PixelStorei(GL_UNPACK_ALIGNMENT, 1);
  current->TextureSubImage2D(id(), 0, 0, 0, width_, height_, layout, type, data);
}

void Texture::Bind(const Current& current, GLuint unit) const { current->BindTextureUnit(unit, id()); }

}  // namespace mixstage::gl
