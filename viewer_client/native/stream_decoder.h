// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"
#include "proto/watch/depth_code.h"
#include "proto/watch/picture_message.h"
#include "viewer_client/native/video_decoder.h"

namespace mixstage {

// A picture of the colour stream. Planes are the decoder's, valid while the callback runs: clone() to keep.
struct ColorPicture {
  WatchHeader header;
  YuvImage image;  // 4:2:0, full range, BT.601 matrix, sRGB
};

// A picture of the depth stream, same validity.
struct WatchedDepth {
  WatchHeader header;
  cv::Mat1f depth_m;      // [h x w] metres, 0 = nothing known
  cv::Mat1b alpha;        // [(h+1)/2 x (w+1)/2] coverage of the actor, 0..255
  cv::Mat1w label_codes;  // same size, lossy: CodeToLabel()
};

enum class DecodeOutcome {
  kPicture = 1,
  kWaiting,      // decoding has not started: no key frame has come yet
  kUndecodable,  // damaged, or predicted from a damaged one; a key frame is needed
};

// Both streams' decoders: a stream starts at a key frame, and again after any failure. One thread at a time.
class StreamDecoder {
 public:
  static Result<StreamDecoder> Create();

  DecodeOutcome DecodeColor(const WatchPictureView& picture, ColorPicture* out);
  DecodeOutcome DecodeDepth(const WatchPictureView& picture, WatchedDepth* out);
  // A new connection: both streams start again.
  void Reset();

 private:
  enum class State { kWaiting = 1, kRunning, kFailed };
  struct Stream {
    explicit Stream(VideoDecoder made) : decoder(std::move(made)) {}
    VideoDecoder decoder;
    State state = State::kWaiting;
  };
  StreamDecoder(VideoDecoder color, VideoDecoder depth)
      : color_(std::move(color)), depth_(std::move(depth)) {}
  static DecodeOutcome Decode(const WatchPictureView& picture, Stream* stream, DecodedPlanes* planes);

  Stream color_, depth_;
  DepthRange table_range_{0, 0};
  std::array<float, 1024> depth_of_code_{};  // of table_range_
  cv::Mat1f depth_m_;
  cv::Mat1b alpha_;
};

}  // namespace mixstage
