// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/jpeg.h"

#include <turbojpeg.h>

#include <opencv2/imgproc.hpp>
#include <string>

namespace mixstage {

struct JpegDecoder::State {
  JpegLimits limits;
  tjhandle handle = tjInitDecompress();
  cv::Mat1b scratch[3];  // planes of layouts that are not kept
  ~State() {
    if (handle) tjDestroy(handle);
  }
};

JpegDecoder::JpegDecoder(const JpegLimits& limits) : state_(std::make_unique<State>()) {
  state_->limits = limits;
  MIX_CHECK(state_->handle != nullptr);
}
JpegDecoder::~JpegDecoder() = default;
JpegDecoder::JpegDecoder(JpegDecoder&&) noexcept = default;
JpegDecoder& JpegDecoder::operator=(JpegDecoder&&) noexcept = default;

namespace {

struct ParsedHeader {
  int width = 0, height = 0, subsampling = 0, colorspace = 0;
};

Result<ParsedHeader> ParseHeader(tjhandle handle, const JpegLimits& limits,
                                 std::span<const std::uint8_t> jpeg) {
  if (jpeg.size() > limits.max_bytes) {
    return Fail(ErrorCode::kBadInput, "JPEG of " + std::to_string(jpeg.size()) + " bytes is over the limit");
  }
  ParsedHeader h;
  if (jpeg.size() < 4 || tjDecompressHeader3(handle, jpeg.data(), static_cast<unsigned long>(jpeg.size()),
                                             &h.width, &h.height, &h.subsampling, &h.colorspace) != 0) {
    return Fail(ErrorCode::kBadInput, std::string("not a JPEG: ") + tjGetErrorStr2(handle));
  }
  if (h.width < 1 || h.height < 1 || h.width > limits.max_width_px || h.height > limits.max_height_px ||
      std::int64_t{h.width} * h.height > limits.max_pixels) {
    return Fail(ErrorCode::kBadInput, "JPEG of " + std::to_string(h.width) + " x " +
                                          std::to_string(h.height) + " pixels is over the limit");
  }
  if (h.colorspace != TJCS_YCbCr && h.colorspace != TJCS_GRAY) {
    return Fail(ErrorCode::kBadInput, "JPEG is neither Y'CbCr nor grey");
  }
  return h;
}

}  // namespace

Result<JpegDecoder::Header> JpegDecoder::ReadHeader(std::span<const std::uint8_t> jpeg) {
  auto header = ParseHeader(state_->handle, state_->limits, jpeg);
  if (!header) return tl::unexpected(header.error());
  return Header{header->width, header->height};
}

Status JpegDecoder::Decode(std::span<const std::uint8_t> jpeg, YuvImage& image) {
  auto header = ParseHeader(state_->handle, state_->limits, jpeg);
  if (!header) return tl::unexpected(header.error());
  const int w = header->width;
  const int h = header->height;
  const bool kept = header->subsampling == TJSAMP_444 || header->subsampling == TJSAMP_422 ||
                    header->subsampling == TJSAMP_420;
  image.Create(w, h,
               header->subsampling == TJSAMP_444   ? ChromaLayout::k444
               : header->subsampling == TJSAMP_422 ? ChromaLayout::k422
               : header->subsampling == TJSAMP_420 ? ChromaLayout::k420
                                                   : ChromaLayout::k444);
  cv::Mat1b* planes[3] = {&image.y, &image.cb, &image.cr};
  unsigned char* data[3] = {};
  int strides[3] = {};
  const int count = header->subsampling == TJSAMP_GRAY ? 1 : 3;
  for (int i = 0; i < count; ++i) {
    cv::Mat1b& plane = (i == 0 || kept) ? *planes[i] : state_->scratch[i];
    if (&plane == &state_->scratch[i]) {
      plane.create(tjPlaneHeight(i, h, header->subsampling), tjPlaneWidth(i, w, header->subsampling));
    }
    data[i] = plane.data;
    strides[i] = static_cast<int>(plane.step);
  }
  if (tjDecompressToYUVPlanes(state_->handle, jpeg.data(), static_cast<unsigned long>(jpeg.size()), data, w,
                              strides, h, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS) != 0) {
    return Fail(ErrorCode::kBadInput, std::string("damaged JPEG: ") + tjGetErrorStr2(state_->handle));
  }
  if (count == 1) {
    image.cb.setTo(128);
    image.cr.setTo(128);
  } else if (!kept) {
    // 4:4:0 and 4:1:1 are rare: brought to 4:4:4 so that the rest of the program knows three layouts only.
    cv::resize(state_->scratch[1], image.cb, cv::Size(w, h), 0, 0, cv::INTER_LINEAR);
    cv::resize(state_->scratch[2], image.cr, cv::Size(w, h), 0, 0, cv::INTER_LINEAR);
  }
  return {};
}

struct JpegEncoder::State {
  tjhandle handle = tjInitCompress();
  cv::Mat1b luma;  // of odd pictures
  ~State() {
    if (handle) tjDestroy(handle);
  }
};

JpegEncoder::JpegEncoder() : state_(std::make_unique<State>()) { MIX_CHECK(state_->handle != nullptr); }
JpegEncoder::~JpegEncoder() = default;
JpegEncoder::JpegEncoder(JpegEncoder&&) noexcept = default;
JpegEncoder& JpegEncoder::operator=(JpegEncoder&&) noexcept = default;

Status JpegEncoder::Encode(const YuvImage& image, int quality, std::vector<std::uint8_t>& jpeg) {
  MIX_CHECK(!image.empty() && quality >= 1 && quality <= 100);
  const int subsampling = image.layout == ChromaLayout::k444   ? TJSAMP_444
                          : image.layout == ChromaLayout::k422 ? TJSAMP_422
                                                               : TJSAMP_420;
  jpeg.resize(tjBufSize(image.width(), image.height(), subsampling));
  unsigned char* out = jpeg.data();
  auto size = static_cast<unsigned long>(jpeg.size());
  // The library reads whole chroma blocks: an odd picture is continued by its last row and column.
  const bool padded = subsampling != TJSAMP_444 && ((image.width() | image.height()) & 1) != 0;
  if (padded) {
    cv::copyMakeBorder(image.y, state_->luma, 0, image.height() & 1, 0, image.width() & 1,
                       cv::BORDER_REPLICATE);
  }
  const cv::Mat1b& luma = padded ? state_->luma : image.y;
  const unsigned char* planes[3] = {luma.data, image.cb.data, image.cr.data};
  const int strides[3] = {static_cast<int>(luma.step), static_cast<int>(image.cb.step),
                          static_cast<int>(image.cr.step)};
  if (tjCompressFromYUVPlanes(state_->handle, planes, image.width(), strides, image.height(), subsampling,
                              &out, &size, quality, TJFLAG_NOREALLOC) != 0) {
    return Fail(ErrorCode::kInternal, std::string("JPEG encoder: ") + tjGetErrorStr2(state_->handle));
  }
  jpeg.resize(size);
  return {};
}

}  // namespace mixstage
