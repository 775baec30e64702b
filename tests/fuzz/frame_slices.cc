// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "proto/link/reassembler.h"
#include "tests/fuzz/slice_records.h"

// Datagrams to pictures: in bounded memory, and none is delivered that is out of its limits.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  Reassembler reassembler;
  ForEachSlice({data, size}, [&](const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us) {
    reassembler.Add(slice, now_us);
    MIX_CHECK(reassembler.open_bytes() <= Reassembler::kMaxOpenBytes);
    while (const auto picture = reassembler.Next(now_us)) {
      MIX_CHECK(!picture->bytes.empty() && picture->bytes.size() <= std::size_t{kMaxFrameBytes});
      MIX_CHECK(picture->width <= kMaxPictureSide && picture->height <= kMaxPictureSide);
      MIX_CHECK(picture->sequence >= 0 && picture->epoch != 0);
    }
    const auto stats = reassembler.Stats(slice.epoch, now_us);
    MIX_CHECK(stats.slice_loss >= 0 && stats.slice_loss <= 1);
  });
  return 0;
}
