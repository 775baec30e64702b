// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "proto/watch/text_message.h"

// What a viewer understands is written as a message that means the same.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto message = ParseServerMessage({reinterpret_cast<const char*>(data), size});
  if (!message) return 0;
  const auto text = std::visit([](const auto& m) { return ToJson(m); }, *message);
  const auto again = ParseServerMessage(text);
  MIX_CHECK(again && again->index() == message->index());
  return 0;
}
