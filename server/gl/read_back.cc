// SPDX-License-Identifier: Apache-2.0
#include "server/gl/read_back.h"

namespace mixstage::gl {
namespace {

// Longer than any picture takes. Software drivers share their cores with whatever else runs.
constexpr GLuint64 kGpuPatienceNs = 400'000'000;
constexpr GLuint64 kSoftwarePatienceNs = 10'000'000'000;

}  // namespace

Status ReadBack::Start(const Current& current, const Framebuffer& from, int attachment,
                       const cv::Rect& region, GLenum layout, GLenum type, std::size_t pixel_bytes) {
  const auto bytes =
      static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height) * pixel_bytes;
  if (bytes > capacity_) {
    GLuint id = 0;
    current->CreateBuffers(1, &id);
    buffer_.emplace(current, Name::Kind::kBuffer, id);
    constexpr GLbitfield kRead = GL_MAP_READ_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT;
    const auto size = static_cast<GLsizeiptr>(bytes);
    current->NamedBufferStorage(id, size, nullptr, kRead | GL_CLIENT_STORAGE_BIT);
    memory_ = static_cast<const std::byte*>(current->MapNamedBufferRange(id, 0, size, kRead));
    capacity_ = memory_ != nullptr ? bytes : 0;
    if (auto ok = current.Check("read-back"); !ok) return ok;
    if (memory_ == nullptr) return Fail(ErrorCode::kInternal, "read-back: no memory shared with the GPU");
  }
  asked_ = bytes;
  current->NamedFramebufferReadBuffer(from.id(), GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(attachment));
  current->BindFramebuffer(GL_READ_FRAMEBUFFER, from.id());
  current->BindBuffer(GL_PIXEL_PACK_BUFFER, buffer_->id());
  current->PixelStorei(GL_PACK_ALIGNMENT, 1);
  current->ReadPixels(region.x, region.y, region.width, region.height, layout, type, nullptr);
  current->BindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  if (fence_ != nullptr) current->DeleteSync(fence_);
  fence_ = current->FenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
  return {};
}

Result<std::span<const std::byte>> ReadBack::Wait(const Current& current) {
  const GLenum done = current->ClientWaitSync(fence_, GL_SYNC_FLUSH_COMMANDS_BIT,
                                              current.info().software ? kSoftwarePatienceNs : kGpuPatienceNs);
  current->DeleteSync(fence_);
  fence_ = nullptr;
  if (auto ok = current.Check("read-back"); !ok) return tl::unexpected(ok.error());
  if (done != GL_ALREADY_SIGNALED && done != GL_CONDITION_SATISFIED) {
    current.GiveUp();
    return Fail(ErrorCode::kUnavailable, "read-back: the GPU does not answer");
  }
  return std::span<const std::byte>(memory_, asked_);
}

}  // namespace mixstage::gl
