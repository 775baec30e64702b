// SPDX-License-Identifier: Apache-2.0
#include "proto/link/frame_slice.h"

#include <algorithm>
#include <cstring>

#include "proto/base/check.h"
#include "proto/base/crc32c.h"

namespace mixstage {

void CutIntoSlices(const EncodedFrame& frame,
                   const std::function<void(const mixstage_lcm::frame_slice_t&)>& send) {
  MIX_CHECK(!frame.bytes.empty() && frame.bytes.size() <= static_cast<std::size_t>(kMaxFrameBytes));
  MIX_CHECK(frame.width >= 1 && frame.height >= 1 && std::max(frame.width, frame.height) <= kMaxPictureSide);
  mixstage_lcm::frame_slice_t slice{};
  slice.epoch = frame.epoch;
  slice.t_us = frame.t_us;
  slice.sequence = frame.sequence;
  slice.frame_bytes = static_cast<std::int32_t>(frame.bytes.size());
  slice.frame_crc32c = static_cast<std::int32_t>(Crc32c(frame.bytes));
  slice.width = static_cast<std::int16_t>(frame.width);
  slice.height = static_cast<std::int16_t>(frame.height);
  slice.stream = static_cast<std::int8_t>(frame.stream);
  slice.encoding = static_cast<std::int8_t>(frame.encoding);
  slice.slice_bytes = kSlicePayloadBytes;
  slice.data_slices =
      static_cast<std::int16_t>((slice.frame_bytes + kSlicePayloadBytes - 1) / kSlicePayloadBytes);
  for (int i = 0; i < slice.data_slices; ++i) {
    slice.slice = static_cast<std::int16_t>(i);
    const std::size_t begin = static_cast<std::size_t>(i) * kSlicePayloadBytes;
    const std::size_t count = std::min<std::size_t>(kSlicePayloadBytes, frame.bytes.size() - begin);
    std::memcpy(slice.payload, frame.bytes.data() + begin, count);
    std::memset(slice.payload + count, 0, kSlicePayloadBytes - count);
    send(slice);
  }
}

Status ValidateSlice(const mixstage_lcm::frame_slice_t& s) {
  auto bad = [](const char* field) {
    return Fail(ErrorCode::kBadInput, std::string("slice field ") + field);
  };
  if (s.epoch == 0) return bad("epoch");
  if (!IsCountable(s.t_us)) return bad("t_us");
  if (s.sequence < 0 || !IsCountable(s.sequence)) return bad("sequence");
  if (s.frame_bytes < 1 || s.frame_bytes > kMaxFrameBytes) return bad("frame_bytes");
  if (s.width < 1 || s.width > kMaxPictureSide) return bad("width");
  if (s.height < 1 || s.height > kMaxPictureSide) return bad("height");
  if (s.slice_bytes < 1 || s.slice_bytes > kSlicePayloadBytes) return bad("slice_bytes");
  if (s.data_slices != (s.frame_bytes + s.slice_bytes - 1) / s.slice_bytes) return bad("data_slices");
  if (s.parity_slices < 0 || s.parity_slices > s.data_slices) return bad("parity_slices");
  if (s.slice < 0 || s.slice >= s.data_slices + s.parity_slices) return bad("slice");
  if (s.stream < 1 || s.stream > 4) return bad("stream");
  const bool color =
      s.stream == static_cast<int>(Stream::kColor) || s.stream == static_cast<int>(Stream::kFisheye);
  if (s.encoding != static_cast<int>(color ? Encoding::kJpeg : Encoding::kDepth16)) return bad("encoding");
  return {};
}

}  // namespace mixstage
