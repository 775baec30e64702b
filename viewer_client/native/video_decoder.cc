// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/video_decoder.h"

extern "C" {
#include <libavcodec/avcodec.h>
}

#include <cstring>
#include <utility>
#include <vector>

namespace mixstage {
namespace {

constexpr std::int64_t kMaxPixels = 1 << 24;

struct LibavDelete {
  void operator()(AVCodecContext* context) const { avcodec_free_context(&context); }
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
};

tl::unexpected<Error> Refuse(const char* why) {
  return Fail(ErrorCode::kBadInput, std::string("H.264: ") + why);
}

}  // namespace

class VideoDecoder::Impl {
 public:
  explicit Impl(WatchStream stream) : stream_(stream) {}

  Status Open() {
    av_log_set_level(AV_LOG_QUIET);  // what it would say to the terminal, the return codes say to us
    const AVCodec* codec = avcodec_find_decoder(AV_CODEC_ID_H264);
    if (codec == nullptr)
      return Fail(ErrorCode::kUnavailable, "libavcodec was built without its H.264 decoder");
    context_.reset(avcodec_alloc_context3(codec));
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    if (!context_ || !frame_ || !packet_) return Fail(ErrorCode::kInternal, "H.264 decoder: out of memory");
    context_->thread_count = 1;  // more threads would hold pictures back
    context_->flags |= AV_CODEC_FLAG_LOW_DELAY;
    context_->err_recognition = AV_EF_EXPLODE;
    context_->error_concealment = 0;
    context_->max_pixels = kMaxPixels;
    if (avcodec_open2(context_.get(), codec, nullptr) < 0) {
      return Fail(ErrorCode::kUnavailable, "libavcodec's H.264 decoder does not open");
    }
    return {};
  }

  Result<DecodedPlanes> Decode(std::span<const std::uint8_t> access_unit) {
    // libavcodec reads a little beyond the end.
    input_.resize(access_unit.size() + AV_INPUT_BUFFER_PADDING_SIZE);
    std::memcpy(input_.data(), access_unit.data(), access_unit.size());
    std::memset(input_.data() + access_unit.size(), 0, AV_INPUT_BUFFER_PADDING_SIZE);
    packet_->data = input_.data();
    packet_->size = static_cast<int>(access_unit.size());
    const int sent = avcodec_send_packet(context_.get(), packet_.get());
    packet_->data = nullptr;
    packet_->size = 0;
    if (sent < 0) return Refuse("the access unit is damaged");
    if (avcodec_receive_frame(context_.get(), frame_.get()) < 0)
      return Refuse("the access unit holds no whole picture");
    const AVFrame& frame = *frame_;
    if (frame.decode_error_flags != 0 || (frame.flags & AV_FRAME_FLAG_CORRUPT) != 0) {
      return Refuse("the picture is damaged or refers to one that is missing");
    }
    const bool eight_bit = frame.format == AV_PIX_FMT_YUV420P || frame.format == AV_PIX_FMT_YUVJ420P;
    if (stream_ == WatchStream::kColor ? !eight_bit : frame.format != AV_PIX_FMT_YUV420P10LE) {
      return Refuse("not 4:2:0 of the stream's bit depth");
    }
    const int type = stream_ == WatchStream::kColor ? CV_8U : CV_16U;
    const auto plane = [&frame, type](int index, int width, int height) {
      return cv::Mat(height, width, type, frame.data[index], static_cast<std::size_t>(frame.linesize[index]));
    };
    const int half_width = (frame.width + 1) / 2, half_height = (frame.height + 1) / 2;
    return DecodedPlanes{plane(0, frame.width, frame.height), plane(1, half_width, half_height),
                         plane(2, half_width, half_height)};
  }

  void Reset() { avcodec_flush_buffers(context_.get()); }

 private:
  const WatchStream stream_;
  std::unique_ptr<AVCodecContext, LibavDelete> context_;
  std::unique_ptr<AVFrame, LibavDelete> frame_;
  std::unique_ptr<AVPacket, LibavDelete> packet_;
  std::vector<std::uint8_t> input_;
};

VideoDecoder::VideoDecoder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
VideoDecoder::VideoDecoder(VideoDecoder&&) noexcept = default;
VideoDecoder& VideoDecoder::operator=(VideoDecoder&&) noexcept = default;
VideoDecoder::~VideoDecoder() = default;

Result<VideoDecoder> VideoDecoder::Create(WatchStream stream) {
  auto impl = std::make_unique<Impl>(stream);
  if (const Status opened = impl->Open(); !opened) return tl::unexpected(opened.error());
  return VideoDecoder(std::move(impl));
}

Result<DecodedPlanes> VideoDecoder::Decode(std::span<const std::uint8_t> access_unit) {
  return impl_->Decode(access_unit);
}
void VideoDecoder::Reset() { impl_->Reset(); }

}  // namespace mixstage
