// SPDX-License-Identifier: Apache-2.0
//
// Texts in messages of a fixed size: UTF-8, zero-padded.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <string_view>

namespace mixstage {

// The beginning that fits into `bytes`, not within a character.
[[nodiscard]] inline std::string_view Fitting(std::string_view text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xC0) == 0x80) --bytes;
  return text.substr(0, bytes);
}

// `out` is zero before; what does not fit is cut.
template <std::size_t kBytes>
void WriteFixedText(std::string_view text, std::uint8_t (&out)[kBytes]) {
  const std::string_view fits = Fitting(text, kBytes);
  std::copy(fits.begin(), fits.end(), std::begin(out));
}

// Control characters but new lines become spaces.
template <std::size_t kBytes>
[[nodiscard]] std::string ReadFixedText(const std::uint8_t (&bytes)[kBytes]) {
  std::string text(std::begin(bytes), std::find(std::begin(bytes), std::end(bytes), 0));
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return (c < ' ' && c != '\n') || c == 0x7F; }, ' ');
  return text;
}

}  // namespace mixstage
