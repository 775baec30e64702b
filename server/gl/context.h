// SPDX-License-Identifier: Apache-2.0
//
// An OpenGL 4.5 context without a window or a surface: EGL on a GPU's device, or on Mesa's software
// rasteriser. It belongs to no thread: a pass enters it, draws and leaves it again, so that whoever owns the
// pass may hand it to another thread between two pictures.
#pragma once

#include <memory>
#include <string>

#include "proto/base/result.h"
#include "server/gl/functions.h"

namespace mixstage::gl {

struct RendererInfo {
  std::string vendor, renderer, version;
  bool software = false;  // no GPU: the driver draws on the processor's cores
  int max_side_px = 0;    // of a texture
  int max_buffer_texels = 0;
};

// What a context and everything made in it share.
struct ContextState;

// Proof that a context is current on this thread, for as long as it lives; everything that makes or uses GL
// objects asks for one. One at a time (checked: our bug). What a pass needs of the GL state it sets itself.
class Current {
 public:
  Current(Current&&) noexcept = default;
  Current& operator=(Current&&) = delete;
  ~Current();

  // current->DrawArrays(...) is glDrawArrays(...).
  const Functions* operator->() const;
  [[nodiscard]] const RendererInfo& info() const;
  // Fails (kUnavailable) when the context is lost (nothing drawn since is worth anything) and kInternal when
  // GL reports an error; `what` stands in front.
  [[nodiscard]] Status Check(const char* what) const;
  // The GPU hangs: the context counts as lost from now on.
  void GiveUp() const;

 private:
  friend class Context;
  friend class Name;
  explicit Current(std::shared_ptr<ContextState> state) : state_(std::move(state)) {}
  std::shared_ptr<ContextState> state_;
};

enum class Devices {
  kAny = 1,   // GPUs first, then software
  kGpusOnly,  // a software driver is not even loaded (a hundred megabytes of compiler)
};

class Context {
 public:
  // On the first device that makes one. Fails (kUnavailable, what to
  // install said) without EGL or without OpenGL 4.5. The display stays open for the life of the process: EGL
  // has one a device, shared by all contexts.
  static Result<Context> Create(Devices devices = Devices::kAny);

  // Fails (kUnavailable) when it is lost: it will not come back, make another.
  Result<Current> Enter();
  [[nodiscard]] const RendererInfo& info() const;

  // Behaves from now on as after a reset of the GPU.
  void LoseForTest();

 private:
  explicit Context(std::shared_ptr<ContextState> state) : state_(std::move(state)) {}
  std::shared_ptr<ContextState> state_;
};

// A GL object's name. Dropping it, on whatever thread, leaves the object to the next that enters its context.
class Name {
 public:
  enum class Kind { kBuffer = 1, kTexture, kFramebuffer, kProgram, kVertexArray };
  Name(const Current& current, Kind kind, GLuint id);
  Name(Name&& other) noexcept;
  Name& operator=(Name&& other) noexcept;
  ~Name();
  [[nodiscard]] GLuint id() const { return id_; }

 private:
  std::shared_ptr<ContextState> state_;
  Kind kind_;
  GLuint id_ = 0;
};

}  // namespace mixstage::gl
