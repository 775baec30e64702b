// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/stream_decoder.h"

#include <algorithm>
#include <utility>

namespace mixstage {

Result<StreamDecoder> StreamDecoder::Create() {
  Result<VideoDecoder> color = VideoDecoder::Create(WatchStream::kColor);
  if (!color) return tl::unexpected(color.error());
  Result<VideoDecoder> depth = VideoDecoder::Create(WatchStream::kDepth);
  if (!depth) return tl::unexpected(depth.error());
  return StreamDecoder(std::move(*color), std::move(*depth));
}

void StreamDecoder::Reset() {
  for (Stream* stream : {&color_, &depth_}) {
    stream->decoder.Reset();
    stream->state = State::kWaiting;
  }
}

DecodeOutcome StreamDecoder::Decode(const WatchPictureView& picture, Stream* stream, DecodedPlanes* planes) {
  if (stream->state != State::kRunning && !picture.header.key_frame) {
    return stream->state == State::kWaiting ? DecodeOutcome::kWaiting : DecodeOutcome::kUndecodable;
  }
  Result<DecodedPlanes> decoded = stream->decoder.Decode(picture.payload);
  if (!decoded) {
    stream->decoder.Reset();
    stream->state = State::kFailed;
    return DecodeOutcome::kUndecodable;
  }
  stream->state = State::kRunning;
  *planes = std::move(*decoded);
  return DecodeOutcome::kPicture;
}

DecodeOutcome StreamDecoder::DecodeColor(const WatchPictureView& picture, ColorPicture* out) {
  DecodedPlanes planes;
  const DecodeOutcome outcome = Decode(picture, &color_, &planes);
  if (outcome != DecodeOutcome::kPicture) return outcome;
  out->header = picture.header;
  out->image.layout = ChromaLayout::k420;
  out->image.y = planes.y;
  out->image.cb = planes.cb;
  out->image.cr = planes.cr;
  return outcome;
}

DecodeOutcome StreamDecoder::DecodeDepth(const WatchPictureView& picture, WatchedDepth* out) {
  DecodedPlanes planes;
  const DecodeOutcome outcome = Decode(picture, &depth_, &planes);
  if (outcome != DecodeOutcome::kPicture) return outcome;
  const DepthRange range{picture.header.near_m, picture.header.far_m};
  if (range != table_range_) {
    table_range_ = range;
    for (int code = 0; code < 1024; ++code)
      depth_of_code_[static_cast<std::size_t>(code)] = CodeToDepth(code, range);
  }
  depth_m_.create(planes.y.rows, planes.y.cols);
  for (int y = 0; y < planes.y.rows; ++y) {
    const std::uint16_t* codes = planes.y.ptr<std::uint16_t>(y);
    float* depth = depth_m_.ptr<float>(y);
    for (int x = 0; x < planes.y.cols; ++x) depth[x] = depth_of_code_[codes[x] & 1023u];
  }
  alpha_.create(planes.cb.rows, planes.cb.cols);
  for (int y = 0; y < planes.cb.rows; ++y) {
    const std::uint16_t* codes = planes.cb.ptr<std::uint16_t>(y);
    std::uint8_t* alpha = alpha_.ptr<std::uint8_t>(y);
    for (int x = 0; x < planes.cb.cols; ++x) alpha[x] = CodeToAlpha(codes[x]);
  }
  out->header = picture.header;
  out->depth_m = depth_m_;
  out->alpha = alpha_;
  out->label_codes = planes.cr;
  return outcome;
}

}  // namespace mixstage
