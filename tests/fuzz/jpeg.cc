// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/jpeg.h"
#include "proto/base/check.h"

// The JPEG gate: planes that fit the header, or an error; and what was decoded can be encoded.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static JpegDecoder decoder({.max_width_px = 512, .max_height_px = 512, .max_pixels = 512 * 512});
  static JpegEncoder encoder;
  YuvImage image;
  const auto header = decoder.ReadHeader({data, size});
  if (!decoder.Decode({data, size}, image)) return 0;
  MIX_CHECK(header && image.width() == header->width && image.height() == header->height);
  MIX_CHECK(image.cb.size() == image.cr.size());
  std::vector<std::uint8_t> again;
  MIX_CHECK(encoder.Encode(image, 90, again).has_value());
  MIX_CHECK(decoder.Decode(again, image).has_value());
  return 0;
}
