// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/picture_dump.h"

#include <cmath>

namespace mixstage {

PictureDump::PictureDump(const std::filesystem::path& folder)
    : recorder_({.folder = folder, .planes_as = PlanesAs::kPng}) {}

Result<std::unique_ptr<PictureDump>> PictureDump::Create(const std::filesystem::path& folder) {
  std::unique_ptr<PictureDump> dump(new PictureDump(folder));
  if (auto ok = dump->recorder_.Start(); !ok) return Within("--dump", ok.error());
  return dump;
}

void PictureDump::Color(const ColorPicture& picture) {
  YuvImage own;  // the planes are the decoder's
  own.layout = picture.image.layout;
  own.y = picture.image.y.clone();
  own.cb = picture.image.cb.clone();
  own.cr = picture.image.cr.clone();
  recorder_.Picture(TakeList::kColor, picture.header.capture_us, std::move(own));
}

void PictureDump::Depth(const WatchedDepth& picture) {
  cv::Mat1w depth_mm(picture.depth_m.rows, picture.depth_m.cols);
  for (int y = 0; y < depth_mm.rows; ++y) {
    for (int x = 0; x < depth_mm.cols; ++x) {
      const float mm = std::round(picture.depth_m(y, x) * 1000);
      depth_mm(y, x) = mm <= 65535 ? static_cast<std::uint16_t>(mm) : std::uint16_t{0};
    }
  }
  recorder_.Picture(TakeList::kDepth, picture.header.capture_us, std::move(depth_mm));
}

RecordingStatus PictureDump::Finish() {
  recorder_.Stop();
  return recorder_.status();
}

}  // namespace mixstage
