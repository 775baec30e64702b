// SPDX-License-Identifier: Apache-2.0
//
// Owners of libav's objects, its errors as text, its log as debug lines of ours.
#pragma once

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavutil/opt.h>
}

#include <memory>
#include <string>

namespace mixstage {

struct LibavDelete {
  void operator()(AVCodecContext* context) const { avcodec_free_context(&context); }
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
};
using LibavContext = std::unique_ptr<AVCodecContext, LibavDelete>;
using LibavFrame = std::unique_ptr<AVFrame, LibavDelete>;
using LibavPacket = std::unique_ptr<AVPacket, LibavDelete>;

[[nodiscard]] std::string LibavError(int error);

// For the whole process: libav keeps one callback. Its warnings and errors become debug lines, the rest is
// dropped: what matters of them comes back as error codes. Any thread, any number of times.
void SendLibavLogToOurs();

}  // namespace mixstage
