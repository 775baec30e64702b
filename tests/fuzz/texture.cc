// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "server/scene/texture_file.h"

// Pictures of strangers' models: as large as their header said, and paid for out of the budget.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  constexpr std::size_t kBudget = 1 << 18;
  std::size_t remaining = kBudget;
  const auto picture = DecodeTexture({data, size}, remaining);
  if (picture) MIX_CHECK(picture->total() == kBudget - remaining);
  return 0;
}
