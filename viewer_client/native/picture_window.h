// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "proto/base/result.h"
#include "viewer_client/native/stream_decoder.h"

namespace mixstage {

// The composite in a window, its depth beside it on demand. Keys: d depth, q or Esc close. The newest picture
// is shown, others are passed over. Create and Step are the main thread's; pictures come from any.
class PictureWindow {
 public:
  // Fails (kInvalidConfig) where there is no display.
  static Result<std::unique_ptr<PictureWindow>> Create(const std::string& title);
  ~PictureWindow();
  PictureWindow(const PictureWindow&) = delete;
  PictureWindow& operator=(const PictureWindow&) = delete;

  // Copies what it needs.
  void SetColor(const ColorPicture& picture);
  void SetDepth(const WatchedDepth& picture);

  enum class State { kOpen = 1, kClosed };
  // Takes what keys and mouse did and draws what is new.
  State Step();

 private:
  class Screen;
  explicit PictureWindow(std::unique_ptr<Screen> screen);

  const std::unique_ptr<Screen> screen_;
  std::mutex mutex_;  // guards what follows
  YuvImage color_;    // newest, not drawn yet; empty = none
  cv::Mat1f depth_m_;
  DepthRange range_;
};

}  // namespace mixstage
