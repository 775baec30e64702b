// SPDX-License-Identifier: Apache-2.0
//
// H.264 for viewers (SPEC.md 4.1) by libavcodec's libx264: one picture in, one access unit out, at once (no B
// frames, no look-ahead, one thread). Key frames come by the clock or on demand and never else, so that a
// caller knows before he packs a picture whether it will be one.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <string>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"

namespace mixstage {

enum class VideoFormat {
  kColor8 = 1,  // 8 bit 4:2:0, full range, BT.601 matrix, BT.709 primaries, sRGB transfer (said in the VUI)
  kDepth10,     // 10 bit 4:2:0, High 10: codes, not colours
};

// x264's presets that fit a live budget; the cost is core-ms of one 1024x768 picture on the reference
// machine.
enum class EncoderPreset {
  kUltrafast = 1,  // 2.6
  kSuperfast,      // 4.9
  kVeryfast,       // 8.2
};
// "ultrafast", "superfast", "veryfast"; fails (kInvalidConfig) on anything else.
Result<EncoderPreset> ParseEncoderPreset(const std::string& name);
[[nodiscard]] const char* PresetName(EncoderPreset preset);

struct VideoEncoderConfig {
  VideoFormat format = VideoFormat::kColor8;
  EncoderPreset preset = EncoderPreset::kUltrafast;
  int bitrate_bps = 4'000'000;        // 100,000 .. 100,000,000
  double key_frame_interval_s = 2.0;  // 0.1 .. 60
  double fps = 30;                    // nominal, for the rate control only: 1 .. 240
};

// 10-bit planes, codes in 0..1023: luma [h x w], chroma [(h+1)/2 x (w+1)/2].
struct Yuv10Image {
  cv::Mat1w y, cb, cr;
};

struct EncodedPicture {
  std::span<const std::uint8_t> access_unit;  // Annex B; the encoder's until its next call
  bool key_frame = false;                     // then SPS and PPS stand in front
};

// One owner thread at a time. Codes an even size: of an odd one the last column or row is not shown.
class VideoEncoder {
 public:
  // Fails with kInvalidConfig on values out of range (named) and sizes outside 16..8192, with kUnavailable
  // where libavcodec has no libx264 of this bit depth.
  static Result<VideoEncoder> Create(const VideoEncoderConfig& config, int width, int height);
  VideoEncoder(VideoEncoder&&) noexcept;
  VideoEncoder& operator=(VideoEncoder&&) noexcept;
  ~VideoEncoder();

  // Of the coded picture.
  [[nodiscard]] int width() const;
  [[nodiscard]] int height() const;

  // The next picture will be a key frame.
  void RequestKeyFrame();
  // Whether a picture captured at this time will be one: asked for, due by the clock, or the first.
  [[nodiscard]] bool KeyFrameDue(std::int64_t capture_us) const;

  // The planes are read in place, with their strides. Format (4:2:0; 8 or 10 bit) and size are those of
  // Create (checked). Fails with kInternal when x264 refuses; the encoder can be used on.
  Result<EncodedPicture> Encode(const YuvImage& picture, std::int64_t capture_us);
  Result<EncodedPicture> Encode(const Yuv10Image& picture, std::int64_t capture_us);

  // WebCodecs' name of what is produced, "avc1.42C01F", read out of the SPS; empty before the first picture.
  [[nodiscard]] const std::string& codec() const;

 private:
  class Impl;
  explicit VideoEncoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mixstage
