// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "proto/base/check.h"
#include "proto/codec/depth_codec.h"

// Lossless: what can be decoded comes back the same after encoding.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static DepthDecoder decoder;
  static DepthEncoder encoder;
  // Large pictures only cost time here: sizes to 256 x 256.
  if (size >= 8 && (data[5] > 1 || data[7] > 1)) return 0;
  cv::Mat1w picture;
  if (!decoder.Decode({data, size}, picture)) return 0;
  std::vector<std::uint8_t> again;
  encoder.Encode(View(picture), again);
  cv::Mat1w same;
  MIX_CHECK(decoder.Decode(again, same).has_value() && same.size() == picture.size());
  MIX_CHECK(std::equal(same.begin(), same.end(), picture.begin()));
  return 0;
}
