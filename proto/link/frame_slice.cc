// SPDX-License-Identifier: Apache-2.0
#include "proto/link/frame_slice.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/crc32c.h"

namespace mixstage {

void CutIntoSlices(const EncodedFrame& frame,
                   const std::function<void(const mixstage_lcm::frame_slice_t&)>& send, double parity) {
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
  slice.parity_slices = static_cast<std::int16_t>(ParitySlices(slice.data_slices, parity));

  auto send_slice = [&](int index, const std::uint8_t* payload) {
    slice.slice = static_cast<std::int16_t>(index);
    std::memcpy(slice.payload, payload, kSlicePayloadBytes);
    slice.slice_crc32c = static_cast<std::int32_t>(SliceCrc32c(slice));
    send(slice);
  };
  // The picture's own bytes are the data slices, all but the last, which is filled up with zeros.
  std::vector<std::uint8_t> last(kSlicePayloadBytes, 0);
  const std::size_t before_last = static_cast<std::size_t>(slice.data_slices - 1) * kSlicePayloadBytes;
  std::copy(frame.bytes.begin() + static_cast<std::ptrdiff_t>(before_last), frame.bytes.end(), last.begin());
  std::vector<const std::uint8_t*> data(static_cast<std::size_t>(slice.data_slices), last.data());
  for (std::size_t i = 0; i + 1 < data.size(); ++i) data[i] = frame.bytes.data() + i * kSlicePayloadBytes;
  for (std::size_t i = 0; i < data.size(); ++i) send_slice(static_cast<int>(i), data[i]);
  if (slice.parity_slices == 0) return;

  std::vector<std::uint8_t> parity_bytes(static_cast<std::size_t>(slice.parity_slices) * kSlicePayloadBytes);
  std::vector<std::uint8_t*> rows(static_cast<std::size_t>(slice.parity_slices));
  for (std::size_t j = 0; j < rows.size(); ++j) rows[j] = parity_bytes.data() + j * kSlicePayloadBytes;
  ParityCoder().Encode(data, rows, kSlicePayloadBytes);
  for (std::size_t j = 0; j < rows.size(); ++j) send_slice(slice.data_slices + static_cast<int>(j), rows[j]);
}

std::uint32_t SliceCrc32c(const mixstage_lcm::frame_slice_t& s) {
  std::array<std::uint8_t, 46> head{};
  std::size_t at = 0;
  auto put = [&](auto value) {
    for (int shift = 8 * (static_cast<int>(sizeof value) - 1); shift >= 0; shift -= 8)
      head[at++] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> shift);
  };
  put(s.epoch), put(s.t_us), put(s.sequence);
  put(s.frame_bytes), put(s.frame_crc32c);
  put(s.width), put(s.height), put(s.slice), put(s.data_slices), put(s.parity_slices), put(s.slice_bytes);
  put(s.stream), put(s.encoding);
  MIX_CHECK(at == head.size());
  return Crc32c(s.payload, Crc32c(head));
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
  if (s.slice_crc32c != static_cast<std::int32_t>(SliceCrc32c(s))) return bad("slice_crc32c");
  return {};
}

}  // namespace mixstage
