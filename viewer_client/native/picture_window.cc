// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/picture_window.h"

#include <SDL2/SDL.h>

#include <algorithm>
#include <cstdlib>
#include <opencv2/imgproc.hpp>
#include <string_view>
#include <utility>

namespace mixstage {
namespace {

struct SdlDelete {
  void operator()(SDL_Window* window) const { SDL_DestroyWindow(window); }
  void operator()(SDL_Renderer* renderer) const { SDL_DestroyRenderer(renderer); }
  void operator()(SDL_Texture* texture) const { SDL_DestroyTexture(texture); }
};
using Texture = std::unique_ptr<SDL_Texture, SdlDelete>;

tl::unexpected<Error> NoDisplay(const std::string& why) {
  return Fail(ErrorCode::kInvalidConfig, "--window: there is no display to open a window on (" + why + ")");
}

// Near red to far blue in steps of inverse depth; unknown (0) is black.
cv::Mat3b DepthColors(const cv::Mat1f& depth_m, const DepthRange& range) {
  cv::Mat1b level(depth_m.rows, depth_m.cols);
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) {
      level(y, x) = static_cast<std::uint8_t>(DepthToCode(depth_m(y, x), range) / 4);
    }
  }
  cv::Mat3b colors;
  cv::applyColorMap(level, colors, cv::COLORMAP_TURBO);
  colors.setTo(cv::Scalar(0, 0, 0), depth_m <= 0);
  return colors;
}

// SDL itself, for as long as the window lives.
struct Sdl {
  ~Sdl() { SDL_Quit(); }
};

}  // namespace

class PictureWindow::Screen {
 public:
  Status Open(const std::string& title) {
    if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr)
      return NoDisplay("neither DISPLAY nor WAYLAND_DISPLAY is set");
    SDL_SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");  // signals are the program's
    if (SDL_Init(SDL_INIT_VIDEO) != 0) return NoDisplay(SDL_GetError());
    // SDL falls back to drivers that show nobody anything.
    const std::string_view driver = SDL_GetCurrentVideoDriver();
    if (driver == "offscreen" || driver == "dummy") return NoDisplay("only SDL's " + std::string(driver));
    SDL_SetYUVConversionMode(SDL_YUV_CONVERSION_JPEG);  // full range, BT.601: SPEC.md 4.1
    SDL_EnableScreenSaver();
    window_.reset(SDL_CreateWindow(title.c_str(), SDL_WINDOWPOS_UNDEFINED, SDL_WINDOWPOS_UNDEFINED, 640, 480,
                                   SDL_WINDOW_RESIZABLE));
    if (!window_) return NoDisplay(SDL_GetError());
    renderer_.reset(SDL_CreateRenderer(window_.get(), -1, 0));
    if (!renderer_) renderer_.reset(SDL_CreateRenderer(window_.get(), -1, SDL_RENDERER_SOFTWARE));
    if (!renderer_) return NoDisplay(SDL_GetError());
    return {};
  }

  // False when somebody wants the window closed.
  bool HandleEvents() {
    SDL_Event event;
    while (SDL_PollEvent(&event) != 0) {
      if (event.type == SDL_QUIT) return false;
      if (event.type == SDL_WINDOWEVENT) redraw_ = true;
      if (event.type != SDL_KEYDOWN || event.key.repeat != 0) continue;
      const SDL_Keycode key = event.key.keysym.sym;
      if (key == SDLK_q || key == SDLK_ESCAPE) return false;
      if (key == SDLK_d) {
        shows_depth_ = !shows_depth_;
        Resize();
      }
    }
    return true;
  }
  [[nodiscard]] bool shows_depth() const { return shows_depth_; }

  void UpdateColor(const YuvImage& image) {
    if (Adapt(color_, image.y.cols, image.y.rows, SDL_PIXELFORMAT_IYUV)) {
      width_ = image.y.cols;
      height_ = image.y.rows;
      Resize();
    }
    SDL_UpdateYUVTexture(color_.texture.get(), nullptr, image.y.data, static_cast<int>(image.y.step),
                         image.cb.data, static_cast<int>(image.cb.step), image.cr.data,
                         static_cast<int>(image.cr.step));
    redraw_ = true;
  }
  void UpdateDepth(const cv::Mat3b& colors) {
    Adapt(depth_, colors.cols, colors.rows, SDL_PIXELFORMAT_BGR24);
    SDL_UpdateTexture(depth_.texture.get(), nullptr, colors.data, static_cast<int>(colors.step));
    redraw_ = true;
  }

  void DrawIfNew() {
    if (!std::exchange(redraw_, false)) return;
    SDL_SetRenderDrawColor(renderer_.get(), 0, 0, 0, 255);
    SDL_RenderClear(renderer_.get());
    const SDL_Rect left{0, 0, width_, height_}, right{width_, 0, width_, height_};
    if (color_.texture) SDL_RenderCopy(renderer_.get(), color_.texture.get(), nullptr, &left);
    if (shows_depth_ && depth_.texture)
      SDL_RenderCopy(renderer_.get(), depth_.texture.get(), nullptr, &right);
    SDL_RenderPresent(renderer_.get());
  }

 private:
  struct SizedTexture {
    Texture texture;
    int width = 0, height = 0;
  };
  // True when the texture had to be made anew.
  bool Adapt(SizedTexture& sized, int width, int height, std::uint32_t format) {
    if (sized.texture && sized.width == width && sized.height == height) return false;
    sized.texture.reset(
        SDL_CreateTexture(renderer_.get(), format, SDL_TEXTUREACCESS_STREAMING, width, height));
    sized.width = width;
    sized.height = height;
    return true;
  }
  void Resize() {
    if (width_ == 0) return;
    const int width = shows_depth_ ? 2 * width_ : width_;
    SDL_RenderSetLogicalSize(renderer_.get(), width, height_);  // scaled to what the window is sized to
    SDL_Rect screen{0, 0, width, height_};
    SDL_GetDisplayUsableBounds(std::max(0, SDL_GetWindowDisplayIndex(window_.get())), &screen);
    const double scale =
        std::min({1.0, static_cast<double>(screen.w) / width, static_cast<double>(screen.h) / height_});
    SDL_SetWindowSize(window_.get(), static_cast<int>(scale * width), static_cast<int>(scale * height_));
    SDL_SetWindowPosition(window_.get(), SDL_WINDOWPOS_CENTERED, SDL_WINDOWPOS_CENTERED);
    redraw_ = true;
  }

  const Sdl sdl_;
  std::unique_ptr<SDL_Window, SdlDelete> window_;
  std::unique_ptr<SDL_Renderer, SdlDelete> renderer_;
  SizedTexture color_, depth_;
  int width_ = 0, height_ = 0;  // px of the colour picture
  bool shows_depth_ = false, redraw_ = true;
};

PictureWindow::PictureWindow(std::unique_ptr<Screen> screen) : screen_(std::move(screen)) {}
PictureWindow::~PictureWindow() = default;

Result<std::unique_ptr<PictureWindow>> PictureWindow::Create(const std::string& title) {
  auto screen = std::make_unique<Screen>();
  if (auto ok = screen->Open(title); !ok) return tl::unexpected(ok.error());
  return std::unique_ptr<PictureWindow>(new PictureWindow(std::move(screen)));
}

void PictureWindow::SetColor(const ColorPicture& picture) {
  const std::lock_guard lock(mutex_);
  color_.layout = picture.image.layout;
  color_.y = picture.image.y.clone();
  color_.cb = picture.image.cb.clone();
  color_.cr = picture.image.cr.clone();
}

void PictureWindow::SetDepth(const WatchedDepth& picture) {
  const std::lock_guard lock(mutex_);
  depth_m_ = picture.depth_m.clone();
  range_ = {picture.header.near_m, picture.header.far_m};
}

PictureWindow::State PictureWindow::Step() {
  if (!screen_->HandleEvents()) return State::kClosed;
  YuvImage color;
  cv::Mat1f depth_m;
  DepthRange range;
  {
    const std::lock_guard lock(mutex_);
    color = std::exchange(color_, {});
    if (screen_->shows_depth()) depth_m = std::exchange(depth_m_, {});
    range = range_;
  }
  if (!color.empty()) screen_->UpdateColor(color);
  if (!depth_m.empty()) screen_->UpdateDepth(DepthColors(depth_m, range));
  screen_->DrawIfNew();
  return State::kOpen;
}

}  // namespace mixstage
