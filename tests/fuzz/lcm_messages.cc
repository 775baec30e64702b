// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdint>
#include <mixstage_lcm/agent_command_t.hpp>
#include <mixstage_lcm/agent_health_t.hpp>
#include <mixstage_lcm/frame_slice_t.hpp>
#include <mixstage_lcm/head_angles_t.hpp>
#include <mixstage_lcm/scan_progress_t.hpp>
#include <vector>

#include "proto/base/check.h"
#include "proto/link/scan_progress.h"

namespace {

// What is decoded encodes to the bytes it came from.
template <typename Message>
void DecodeAs(const std::vector<std::uint8_t>& bytes) {
  const int size = static_cast<int>(bytes.size());
  Message message{};
  if (message.decode(bytes.data(), 0, size) != message.getEncodedSize()) return;
  std::vector<std::uint8_t> again(static_cast<std::size_t>(message.getEncodedSize()));
  MIX_CHECK(message.encode(again.data(), 0, static_cast<int>(again.size())) == message.getEncodedSize());
  MIX_CHECK(std::equal(again.begin(), again.end(), bytes.begin()));
}

}  // namespace

// The first byte says the type, the others are the datagram behind its fingerprint, which stands there by
// itself.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1 || size > 2000) return 0;
  const auto with_fingerprint = [&](std::int64_t hash) {
    std::vector<std::uint8_t> bytes;
    for (int shift = 56; shift >= 0; shift -= 8) bytes.push_back(static_cast<std::uint8_t>(hash >> shift));
    bytes.insert(bytes.end(), data + 1, data + size);
    return bytes;
  };
  switch (data[0] % 6) {
    case 0:
      DecodeAs<mixstage_lcm::frame_slice_t>(with_fingerprint(mixstage_lcm::frame_slice_t::getHash()));
      break;
    case 1:
      DecodeAs<mixstage_lcm::head_angles_t>(with_fingerprint(mixstage_lcm::head_angles_t::getHash()));
      break;
    case 2:
      DecodeAs<mixstage_lcm::agent_health_t>(with_fingerprint(mixstage_lcm::agent_health_t::getHash()));
      break;
    case 3:
      DecodeAs<mixstage_lcm::agent_command_t>(with_fingerprint(mixstage_lcm::agent_command_t::getHash()));
      break;
    case 4: {
      const auto bytes = with_fingerprint(mixstage_lcm::scan_progress_t::getHash());
      DecodeAs<mixstage_lcm::scan_progress_t>(bytes);
      mixstage_lcm::scan_progress_t message{};
      if (message.decode(bytes.data(), 0, static_cast<int>(bytes.size())) < 0) break;
      // What is believed can be said again.
      if (const auto heard = mixstage::ReadScanProgress(message))
        MIX_CHECK(mixstage::ReadScanProgress(mixstage::ToMessage(*heard)).has_value());
      break;
    }
    default:
      DecodeAs<mixstage_lcm::frame_slice_t>({data + 1, data + size});
  }
  return 0;
}
