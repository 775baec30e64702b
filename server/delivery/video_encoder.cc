// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/video_encoder.h"

#include <array>
#include <cmath>
#include <utility>

#include "proto/base/check.h"
#include "server/delivery/h264.h"
#include "server/delivery/libav.h"

namespace mixstage {

const char* PresetName(EncoderPreset preset) {
  switch (preset) {
    case EncoderPreset::kUltrafast:
      return "ultrafast";
    case EncoderPreset::kSuperfast:
      return "superfast";
    case EncoderPreset::kVeryfast:
      return "veryfast";
  }
  return "ultrafast";
}

namespace {

Status Validate(const VideoEncoderConfig& config, int width, int height) {
  const auto refuse = [](const std::string& what) {
    return Fail(ErrorCode::kInvalidConfig, "encoder: " + what);
  };
  if (width < 16 || width > 8192 || height < 16 || height > 8192) {
    return refuse("picture size " + std::to_string(width) + "x" + std::to_string(height) +
                  " is not within 16..8192");
  }
  if (config.bitrate_bps < 100'000 || config.bitrate_bps > 100'000'000) {
    return refuse("bitrate_bps must be within 100000..100000000");
  }
  if (!(config.key_frame_interval_s >= 0.1 && config.key_frame_interval_s <= 60)) {
    return refuse("key_frame_interval_s must be within 0.1..60");
  }
  if (!(config.fps >= 1 && config.fps <= 240)) return refuse("fps must be within 1..240");
  return {};
}

void DropPlane(void* plane, std::uint8_t*) { delete static_cast<cv::Mat*>(plane); }

// libav may keep a reference to a frame's buffers after the call: each holds its plane's cv::Mat alive.
Status WrapPlane(const cv::Mat& plane, int index, AVFrame* frame) {
  auto owner = std::make_unique<cv::Mat>(plane);
  frame->data[index] = plane.data;
  frame->linesize[index] = static_cast<int>(plane.step[0]);
  frame->buf[index] = av_buffer_create(plane.data, plane.step[0] * static_cast<std::size_t>(plane.rows),
                                       DropPlane, owner.get(), AV_BUFFER_FLAG_READONLY);
  if (frame->buf[index] == nullptr) return Fail(ErrorCode::kInternal, "encoder: out of memory");
  std::ignore = owner.release();
  return {};
}

}  // namespace

Result<EncoderPreset> ParseEncoderPreset(const std::string& name) {
  for (const auto preset : {EncoderPreset::kUltrafast, EncoderPreset::kSuperfast, EncoderPreset::kVeryfast}) {
    if (name == PresetName(preset)) return preset;
  }
  return Fail(ErrorCode::kInvalidConfig, "preset \"" + name + "\" is none of ultrafast, superfast, veryfast");
}

class VideoEncoder::Impl {
 public:
  Impl(const VideoEncoderConfig& config, int width, int height)
      : config_(config), picture_width_(width), picture_height_(height) {}

  Status Open() {
    SendLibavLogToOurs();
    const AVCodec* codec = avcodec_find_encoder_by_name("libx264");
    if (codec == nullptr) {
      return Fail(ErrorCode::kUnavailable, "encoder: libavcodec was built without libx264 (Debian's has it)");
    }
    context_.reset(avcodec_alloc_context3(codec));
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    if (!context_ || !frame_ || !packet_) return Fail(ErrorCode::kInternal, "encoder: out of memory");
    AVCodecContext& c = *context_;
    c.width = picture_width_ & ~1;
    c.height = picture_height_ & ~1;
    c.pix_fmt = config_.format == VideoFormat::kColor8 ? AV_PIX_FMT_YUV420P : AV_PIX_FMT_YUV420P10LE;
    c.framerate = av_d2q(config_.fps, 100000);
    c.time_base = av_inv_q(c.framerate);
    c.thread_count = 1;
    c.max_b_frames = 0;
    c.gop_size = 1 << 20;  // key frames are ours to choose
    c.bit_rate = config_.bitrate_bps;
    // A quarter of a second of buffer: a key frame's burst stays short enough for a live viewer's queue.
    c.rc_max_rate = config_.bitrate_bps;
    c.rc_buffer_size = config_.bitrate_bps / 4;
    // Browsers guess what is not said. For depth the tags say that no player may stretch the codes.
    c.color_range = AVCOL_RANGE_JPEG;
    c.colorspace = AVCOL_SPC_SMPTE170M;
    c.color_primaries = AVCOL_PRI_BT709;
    c.color_trc = AVCOL_TRC_IEC61966_2_1;
    c.chroma_sample_location = AVCHROMA_LOC_CENTER;
    const std::array options = {
        std::pair{"preset", PresetName(config_.preset)},
        std::pair{"tune", "zerolatency"},
        std::pair{"forced-idr", "1"},
        // Adaptive quantisation saves bits where eyes do not look; depth is read by numbers.
        std::pair{"x264-params",
                  config_.format == VideoFormat::kColor8 ? "scenecut=0" : "scenecut=0:aq-mode=0:psy=0"},
    };
    for (const auto& [name, value] : options) {
      if (const int error = av_opt_set(c.priv_data, name, value, 0); error < 0) {
        return Fail(ErrorCode::kUnavailable,
                    std::string("encoder: libx264 option ") + name + ": " + LibavError(error));
      }
    }
    if (const int error = avcodec_open2(&c, codec, nullptr); error < 0) {
      return Fail(ErrorCode::kUnavailable, "encoder: libx264 does not open (" + LibavError(error) + ")");
    }
    return {};
  }

  template <typename Plane>
  Result<EncodedPicture> Encode(const Plane& y, const Plane& cb, const Plane& cr, std::int64_t capture_us) {
    MIX_CHECK(y.cols == picture_width_ && y.rows == picture_height_);
    MIX_CHECK(cb.cols == (y.cols + 1) / 2 && cb.rows == (y.rows + 1) / 2 && cr.size() == cb.size());
    const bool key_frame = KeyFrameDue(capture_us);
    const Status sent = Send(y, cb, cr, key_frame);
    av_frame_unref(frame_.get());
    if (!sent) return tl::unexpected(sent.error());
    av_packet_unref(packet_.get());
    if (const int error = avcodec_receive_packet(context_.get(), packet_.get()); error < 0) {
      return Fail(ErrorCode::kInternal, "encoder: no packet (" + LibavError(error) + ")");
    }
    EncodedPicture picture;
    picture.access_unit = {packet_->data, static_cast<std::size_t>(packet_->size)};
    picture.key_frame = (packet_->flags & AV_PKT_FLAG_KEY) != 0;
    if (picture.key_frame) {
      key_frame_wanted_ = false;
      last_key_us_ = capture_us;
      codec_ = AvcCodecString(picture.access_unit).value_or("");
    }
    return picture;
  }

  [[nodiscard]] bool KeyFrameDue(std::int64_t capture_us) const {
    const auto interval_us = static_cast<std::int64_t>(config_.key_frame_interval_s * 1e6);
    // A capture time that runs backwards (another take, another epoch) starts afresh.
    return key_frame_wanted_ || capture_us - last_key_us_ >= interval_us || capture_us < last_key_us_;
  }
  void RequestKeyFrame() { key_frame_wanted_ = true; }
  [[nodiscard]] int width() const { return context_->width; }
  [[nodiscard]] int height() const { return context_->height; }
  [[nodiscard]] const std::string& codec() const { return codec_; }
  [[nodiscard]] VideoFormat format() const { return config_.format; }

 private:
  Status Send(const cv::Mat& y, const cv::Mat& cb, const cv::Mat& cr, bool key_frame) {
    AVFrame& frame = *frame_;
    frame.format = context_->pix_fmt;
    frame.width = context_->width;
    frame.height = context_->height;
    frame.color_range = AVCOL_RANGE_JPEG;
    frame.pts = pictures_++;
    frame.pict_type = key_frame ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
    const std::array<const cv::Mat*, 3> planes = {&y, &cb, &cr};
    for (int i = 0; i < 3; ++i) {
      if (const Status wrapped = WrapPlane(*planes[static_cast<std::size_t>(i)], i, &frame); !wrapped)
        return wrapped;
    }
    if (const int error = avcodec_send_frame(context_.get(), &frame); error < 0) {
      return Fail(ErrorCode::kInternal, "encoder: x264 refused a picture (" + LibavError(error) + ")");
    }
    return {};
  }

  const VideoEncoderConfig config_;
  const int picture_width_, picture_height_;
  LibavContext context_;
  LibavFrame frame_;
  LibavPacket packet_;
  std::int64_t pictures_ = 0;
  std::int64_t last_key_us_ = 0;
  bool key_frame_wanted_ = true;
  std::string codec_;
};

VideoEncoder::VideoEncoder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
VideoEncoder::VideoEncoder(VideoEncoder&&) noexcept = default;
VideoEncoder& VideoEncoder::operator=(VideoEncoder&&) noexcept = default;
VideoEncoder::~VideoEncoder() = default;

Result<VideoEncoder> VideoEncoder::Create(const VideoEncoderConfig& config, int width, int height) {
  if (const Status valid = Validate(config, width, height); !valid) return tl::unexpected(valid.error());
  auto impl = std::make_unique<Impl>(config, width, height);
  if (const Status opened = impl->Open(); !opened) return tl::unexpected(opened.error());
  return VideoEncoder(std::move(impl));
}

int VideoEncoder::width() const { return impl_->width(); }
int VideoEncoder::height() const { return impl_->height(); }
void VideoEncoder::RequestKeyFrame() { impl_->RequestKeyFrame(); }
bool VideoEncoder::KeyFrameDue(std::int64_t capture_us) const { return impl_->KeyFrameDue(capture_us); }
const std::string& VideoEncoder::codec() const { return impl_->codec(); }

Result<EncodedPicture> VideoEncoder::Encode(const YuvImage& picture, std::int64_t capture_us) {
  MIX_CHECK(impl_->format() == VideoFormat::kColor8 && picture.layout == ChromaLayout::k420);
  return impl_->Encode(picture.y, picture.cb, picture.cr, capture_us);
}

Result<EncodedPicture> VideoEncoder::Encode(const Yuv10Image& picture, std::int64_t capture_us) {
  MIX_CHECK(impl_->format() == VideoFormat::kDepth10);
  return impl_->Encode(picture.y, picture.cb, picture.cr, capture_us);
}

}  // namespace mixstage
