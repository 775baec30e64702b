// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "proto/base/crc32c.h"
#include "proto/link/reassembler.h"
#include "tests/fuzz/slice_records.h"

// Datagrams to pictures: whatever is delivered has the length that was announced.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  Reassembler reassembler;
  ForEachSlice({data, size}, [&](const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us) {
    const auto picture = reassembler.Add(slice, now_us);
    if (!picture) return;
    MIX_CHECK(picture->bytes.size() == static_cast<std::size_t>(slice.frame_bytes));
    MIX_CHECK(Crc32c(picture->bytes) == static_cast<std::uint32_t>(slice.frame_crc32c));
  });
  return 0;
}
