// SPDX-License-Identifier: Apache-2.0
#include "server/gl/context.h"

#define EGL_NO_X11
#include <EGL/egl.h>
#include <EGL/eglext.h>

#include <array>
#include <atomic>
#include <mutex>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/base/check.h"

namespace mixstage::gl {

struct ContextState {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  Functions gl;
  RendererInfo info;
  std::atomic<bool> lost = false;
  std::atomic<bool> entered = false;
  std::mutex mutex;
  std::vector<std::pair<Name::Kind, GLuint>> dropped;  // guarded by mutex

  ContextState() = default;
  ContextState(const ContextState&) = delete;
  ContextState& operator=(const ContextState&) = delete;
  ~ContextState() {
    if (context != EGL_NO_CONTEXT) eglDestroyContext(display, context);
  }

  bool MakeCurrent() const {
    return eglBindAPI(EGL_OPENGL_API) == EGL_TRUE &&
           eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context) == EGL_TRUE;
  }
  void Release() const { eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT); }

  void DeleteDropped() {
    const std::lock_guard lock(mutex);
    for (const auto& [kind, id] : dropped) {
      switch (kind) {
        case Name::Kind::kBuffer:
          gl.DeleteBuffers(1, &id);
          break;
        case Name::Kind::kTexture:
          gl.DeleteTextures(1, &id);
          break;
        case Name::Kind::kFramebuffer:
          gl.DeleteFramebuffers(1, &id);
          break;
        case Name::Kind::kProgram:
          gl.DeleteProgram(id);
          break;
        case Name::Kind::kVertexArray:
          gl.DeleteVertexArrays(1, &id);
          break;
      }
    }
    dropped.clear();
  }
};

namespace {

constexpr const char* kNoEgl =
    "no OpenGL 4.5 through EGL on this machine: install a GPU's driver, or libegl-mesa0 and libgl1-mesa-dri "
    "for "
    "Mesa's software rasteriser, or use renderer: cpu";

bool Has(const char* extensions, std::string_view wanted) {
  return extensions != nullptr &&
         (' ' + std::string(extensions) + ' ').find(' ' + std::string(wanted) + ' ') != std::string::npos;
}

template <typename Function>
Function Load(const char* name) {
  return reinterpret_cast<Function>(eglGetProcAddress(name));
}

// GPUs first, then what draws in software, then what Mesa finds without a device.
std::vector<EGLDisplay> Displays(Devices wanted) {
  std::vector<EGLDisplay> gpus, software;
  const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  const auto query_devices = Load<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
  const auto query_string = Load<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
  const auto get_display = Load<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
  if (get_display == nullptr) return {};
  if (Has(client, "EGL_EXT_platform_device") && query_devices != nullptr && query_string != nullptr) {
    std::array<EGLDeviceEXT, 16> devices{};
    EGLint count = 0;
    query_devices(static_cast<EGLint>(devices.size()), devices.data(), &count);
    for (EGLint i = 0; i < count; ++i) {
      EGLDeviceEXT device = devices[static_cast<std::size_t>(i)];
      const bool is_software = Has(query_string(device, EGL_EXTENSIONS), "EGL_MESA_device_software");
      if (is_software && wanted == Devices::kGpusOnly) continue;
      (is_software ? software : gpus).push_back(get_display(EGL_PLATFORM_DEVICE_EXT, device, nullptr));
    }
  }
  // Every GPU is a device: what is left here draws in software.
  if (wanted == Devices::kAny && Has(client, "EGL_MESA_platform_surfaceless")) {
    software.push_back(get_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  }
  gpus.insert(gpus.end(), software.begin(), software.end());
  return gpus;
}

EGLContext MakeContext(EGLDisplay display) {
  EGLint major = 0;
  EGLint minor = 0;
  if (display == EGL_NO_DISPLAY || eglInitialize(display, &major, &minor) != EGL_TRUE) return EGL_NO_CONTEXT;
  const char* extensions = eglQueryString(display, EGL_EXTENSIONS);
  if (!Has(extensions, "EGL_KHR_surfaceless_context") || !Has(extensions, "EGL_KHR_no_config_context") ||
      eglBindAPI(EGL_OPENGL_API) != EGL_TRUE) {
    return EGL_NO_CONTEXT;
  }
  const std::array<EGLint, 7> version = {EGL_CONTEXT_MAJOR_VERSION,
                                         4,
                                         EGL_CONTEXT_MINOR_VERSION,
                                         5,
                                         EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                         EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                         EGL_NONE};
  std::array<EGLint, 9> with_reset_notice{};
  std::copy(version.begin(), version.end() - 1, with_reset_notice.begin());
  with_reset_notice[6] = EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY;
  with_reset_notice[7] = EGL_LOSE_CONTEXT_ON_RESET;
  with_reset_notice[8] = EGL_NONE;
  EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, with_reset_notice.data());
  // A driver that cannot tell of resets still draws.
  if (context == EGL_NO_CONTEXT) {
    context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version.data());
  }
  return context;
}

bool LoadAll(Functions& gl) {
  bool all = true;
#define MIXSTAGE_GL_LOAD(type, name)             \
  gl.name = Load<decltype(gl.name)>("gl" #name); \
  all = all && gl.name != nullptr;
  MIXSTAGE_GL_FUNCTIONS(MIXSTAGE_GL_LOAD)
#undef MIXSTAGE_GL_LOAD
  return all;
}

RendererInfo InfoOf(const Functions& gl) {
  RendererInfo info;
  auto text = [&](GLenum name) {
    const GLubyte* value = gl.GetString(name);
    return value != nullptr ? std::string(reinterpret_cast<const char*>(value)) : std::string();
  };
  info.vendor = text(GL_VENDOR);
  info.renderer = text(GL_RENDERER);
  info.version = text(GL_VERSION);
  for (const char* name : {"llvmpipe", "softpipe", "swrast", "SwiftShader", "Software"}) {
    info.software = info.software || info.renderer.find(name) != std::string::npos;
  }
  gl.GetIntegerv(GL_MAX_TEXTURE_SIZE, &info.max_side_px);
  gl.GetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &info.max_buffer_texels);
  return info;
}

}  // namespace

Result<Context> Context::Create(Devices devices) {
  std::shared_ptr<ContextState> software;
  for (EGLDisplay display : Displays(devices)) {
    auto state = std::make_shared<ContextState>();
    state->display = display;
    state->context = MakeContext(display);
    if (state->context == EGL_NO_CONTEXT || !state->MakeCurrent()) continue;
    const bool complete = LoadAll(state->gl);
    if (complete) state->info = InfoOf(state->gl);
    state->Release();
    if (!complete) continue;
    // A device that did not call itself software may still turn out to be.
    if (!state->info.software) return Context(std::move(state));
    if (!software) software = std::move(state);
  }
  if (!software || devices == Devices::kGpusOnly) return Fail(ErrorCode::kUnavailable, kNoEgl);
  return Context(std::move(software));
}

Result<Current> Context::Enter() {
  MIX_CHECK(!state_->entered.exchange(true));
  if (state_->lost || !state_->MakeCurrent()) {
    state_->lost = true;
    state_->entered = false;
    return Fail(ErrorCode::kUnavailable, "the GPU's context is lost");
  }
  Current current(state_);
  if (auto ok = current.Check("enter"); !ok) return tl::unexpected(ok.error());
  state_->DeleteDropped();
  return current;
}

const RendererInfo& Context::info() const { return state_->info; }
void Context::LoseForTest() { state_->lost = true; }

Current::~Current() {
  if (!state_) return;
  state_->Release();
  state_->entered = false;
}

const Functions* Current::operator->() const { return &state_->gl; }
void Current::GiveUp() const { state_->lost = true; }
const RendererInfo& Current::info() const { return state_->info; }

Status Current::Check(const char* what) const {
  if (state_->gl.GetGraphicsResetStatus() != GL_NO_ERROR) state_->lost = true;
  if (state_->lost) return Fail(ErrorCode::kUnavailable, std::string(what) + ": the GPU's context is lost");
  const GLenum error = state_->gl.GetError();
  if (error == GL_NO_ERROR) return {};
  // Several may wait; a lost context would answer for ever.
  for (int i = 0; i < 16 && state_->gl.GetError() != GL_NO_ERROR; ++i) {
  }
  return Fail(ErrorCode::kInternal,
              std::string(what) + (error == GL_OUT_OF_MEMORY ? ": the GPU's memory is full"
                                                             : ": GL error " + std::to_string(error)));
}

Name::Name(const Current& current, Kind kind, GLuint id) : state_(current.state_), kind_(kind), id_(id) {}
Name::Name(Name&& other) noexcept
    : state_(std::move(other.state_)), kind_(other.kind_), id_(std::exchange(other.id_, 0)) {}
Name& Name::operator=(Name&& other) noexcept {
  std::swap(state_, other.state_);
  std::swap(kind_, other.kind_);
  std::swap(id_, other.id_);
  return *this;
}
Name::~Name() {
  if (!state_ || id_ == 0) return;
  const std::lock_guard lock(state_->mutex);
  state_->dropped.emplace_back(kind_, id_);
}

}  // namespace mixstage::gl
