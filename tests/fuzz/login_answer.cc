// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "proto/watch/login_message.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto login = ParseLoginAnswer({reinterpret_cast<const char*>(data), size});
  if (login) MIX_CHECK(IsTokenText(login->ticket));
  return 0;
}
