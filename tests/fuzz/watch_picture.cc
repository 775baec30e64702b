// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "proto/watch/picture_message.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto picture = ReadWatchPicture({data, size});
  if (!picture) return 0;
  MIX_CHECK(picture->payload.data() >= data &&
            picture->payload.data() + picture->payload.size() == data + size);
  const auto again = WriteWatchPicture(picture->header, picture->payload);
  const auto same = ReadWatchPicture(again);
  MIX_CHECK(same && same->header == picture->header && same->payload.size() == picture->payload.size());
  return 0;
}
