// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/yuv_image.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace mixstage {
namespace {

std::uint8_t Clamp8(float value) {
  return static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
}

// Chroma plane at full size. 4:2:0 and 4:2:2 samples sit between luma pixels (JPEG siting), which is where
// cv::resize's pixel-centre convention puts them as well.
cv::Mat1b FullSizeChroma(const YuvImage& image, const cv::Mat1b& plane) {
  if (image.layout == ChromaLayout::k444) return plane;
  cv::Mat1b full;
  const int sx = 2;
  const int sy = ChromaShiftY(image.layout) ? 2 : 1;
  cv::resize(plane, full, cv::Size(plane.cols * sx, plane.rows * sy), 0, 0, cv::INTER_LINEAR);
  return full(cv::Rect(0, 0, image.width(), image.height()));
}

// Averages blocks of (1 << shift_x) x (1 << shift_y); blocks cut by the border average what there is.
cv::Mat1b ShrinkChroma(const cv::Mat1b& plane, int shift_x, int shift_y) {
  if (shift_x == 0 && shift_y == 0) return plane;
  const int bw = 1 << shift_x;
  const int bh = 1 << shift_y;
  cv::Mat1b padded;
  cv::copyMakeBorder(plane, padded, 0, (bh - plane.rows % bh) % bh, 0, (bw - plane.cols % bw) % bw,
                     cv::BORDER_REPLICATE);
  cv::Mat1b small;
  cv::resize(padded, small, cv::Size(padded.cols / bw, padded.rows / bh), 0, 0, cv::INTER_AREA);
  return small;
}

}  // namespace

void YuvImage::Create(int width, int height, ChromaLayout chroma) {
  layout = chroma;
  const int sx = ChromaShiftX(chroma);
  const int sy = ChromaShiftY(chroma);
  // libjpeg-turbo writes whole chroma blocks: an odd picture's luma plane is a part of an even one.
  if (y.cols != width || y.rows != height || y.step < static_cast<std::size_t>(width + (width & 1)) || !y.u ||
      y.datalimit < y.data + static_cast<std::size_t>(height + (height & 1)) * y.step) {
    y = cv::Mat1b(height + (height & 1), width + (width & 1))(cv::Rect(0, 0, width, height));
  }
  cb.create((height + sy) >> sy, (width + sx) >> sx);
  cr.create((height + sy) >> sy, (width + sx) >> sx);
}

Rgb8 YcbcrToRgb(std::uint8_t y, std::uint8_t cb, std::uint8_t cr) {
  const float fy = y;
  const float fb = static_cast<float>(cb) - 128.f;
  const float fr = static_cast<float>(cr) - 128.f;
  return {Clamp8(fy + 1.402f * fr), Clamp8(fy - 0.344136f * fb - 0.714136f * fr), Clamp8(fy + 1.772f * fb)};
}

Ycbcr8 RgbToYcbcr(Rgb8 rgb) {
  const float r = rgb.r;
  const float g = rgb.g;
  const float b = rgb.b;
  return {Clamp8(0.299f * r + 0.587f * g + 0.114f * b),
          Clamp8(128.f - 0.168736f * r - 0.331264f * g + 0.5f * b),
          Clamp8(128.f + 0.5f * r - 0.418688f * g - 0.081312f * b)};
}

cv::Mat3b ToBgr(const YuvImage& image) {
  const cv::Mat1b cb = FullSizeChroma(image, image.cb);
  const cv::Mat1b cr = FullSizeChroma(image, image.cr);
  cv::Mat3b ycrcb;
  const cv::Mat planes[] = {image.y, cr, cb};
  cv::merge(planes, 3, ycrcb);
  cv::Mat3b bgr;
  cv::cvtColor(ycrcb, bgr, cv::COLOR_YCrCb2BGR);
  return bgr;
}

YuvImage FromBgr(const cv::Mat3b& bgr, ChromaLayout layout) {
  cv::Mat3b ycrcb;
  cv::cvtColor(bgr, ycrcb, cv::COLOR_BGR2YCrCb);
  cv::Mat1b planes[3];
  cv::split(ycrcb, planes);
  YuvImage image;
  image.layout = layout;
  image.y = planes[0];
  image.cr = ShrinkChroma(planes[1], ChromaShiftX(layout), ChromaShiftY(layout));
  image.cb = ShrinkChroma(planes[2], ChromaShiftX(layout), ChromaShiftY(layout));
  return image;
}

YuvImage Crop(const YuvImage& image, const cv::Rect& part) {
  MIX_CHECK((part & cv::Rect(0, 0, image.width(), image.height())) == part && !part.empty());
  MIX_CHECK(part.x % 2 == 0 && part.y % 2 == 0);
  const int x = ChromaShiftX(image.layout), y = ChromaShiftY(image.layout);
  const cv::Rect chroma(part.x >> x, part.y >> y, (part.width + x) >> x, (part.height + y) >> y);
  return {image.layout, image.y(part), image.cb(chroma), image.cr(chroma)};
}

YuvImage To420(const YuvImage& image) {
  if (image.layout == ChromaLayout::k420) return image;
  YuvImage out;
  out.layout = ChromaLayout::k420;
  out.y = image.y;
  const int shift_x = 1 - ChromaShiftX(image.layout);
  out.cb = ShrinkChroma(image.cb, shift_x, 1);
  out.cr = ShrinkChroma(image.cr, shift_x, 1);
  return out;
}

}  // namespace mixstage
