// SPDX-License-Identifier: Apache-2.0
#include "server/gl/framebuffer.h"

#include <array>
#include <vector>

namespace mixstage::gl {

Result<Framebuffer> Framebuffer::Create(const Current& current, std::initializer_list<const Texture*> colors,
                                        const Texture* depth) {
  GLuint id = 0;
  current->CreateFramebuffers(1, &id);
  Framebuffer framebuffer(Name(current, Name::Kind::kFramebuffer, id));
  std::vector<GLenum> buffers;
  for (const Texture* color : colors) {
    buffers.push_back(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(buffers.size()));
    current->NamedFramebufferTexture(id, buffers.back(), color->id(), 0);
  }
  current->NamedFramebufferDrawBuffers(id, static_cast<GLsizei>(buffers.size()), buffers.data());
  if (depth != nullptr) current->NamedFramebufferTexture(id, GL_DEPTH_ATTACHMENT, depth->id(), 0);
  const GLenum status = current->CheckNamedFramebufferStatus(id, GL_FRAMEBUFFER);
  if (auto ok = current.Check("framebuffer"); !ok) return tl::unexpected(ok.error());
  if (status != GL_FRAMEBUFFER_COMPLETE) {
    return Fail(ErrorCode::kInternal,
                "the GPU does not draw into such a framebuffer (" + std::to_string(status) + ")");
  }
  return framebuffer;
}

void Framebuffer::Bind(const Current& current, int width, int height) const {
  current->BindFramebuffer(GL_FRAMEBUFFER, id());
  current->Viewport(0, 0, width, height);
}

void Framebuffer::ClearColor(const Current& current, int attachment, float value) const {
  const std::array<GLfloat, 4> values = {value, value, value, value};
  current->ClearNamedFramebufferfv(id(), GL_COLOR, attachment, values.data());
}

void Framebuffer::ClearColor(const Current& current, int attachment, int value) const {
  const std::array<GLint, 4> values = {value, value, value, value};
  current->ClearNamedFramebufferiv(id(), GL_COLOR, attachment, values.data());
}

void Framebuffer::ClearDepth(const Current& current, float value) const {
  current->ClearNamedFramebufferfv(id(), GL_DEPTH, 0, &value);
}

}  // namespace mixstage::gl
