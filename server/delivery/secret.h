// SPDX-License-Identifier: Apache-2.0
//
// Secrets that are shown to their owner once and kept here as a digest: login tokens and tickets.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

using Sha256 = std::array<std::uint8_t, 32>;

inline constexpr std::size_t kSecretCharacters = 43;  // 256 bits in base64url, without padding

// 256 bits from the kernel's generator as 43 characters. Fails (kInternal) only where there is none.
Result<std::string> MakeSecret();
// 43 characters of base64url's alphabet: anything else is no secret of ours and need not be looked up.
[[nodiscard]] bool IsSecret(std::string_view text);

[[nodiscard]] Sha256 DigestOf(std::string_view secret);
[[nodiscard]] std::string ToHex(const Sha256& digest);  // 64 digits, lower case
[[nodiscard]] std::optional<Sha256> FromHex(std::string_view hex);

// Where `wanted` stands in `digests`. Every one is compared in full, whether an earlier one fits or not: how
// long it takes says nothing about the digests.
[[nodiscard]] std::optional<std::size_t> FindDigest(std::span<const Sha256> digests, const Sha256& wanted);

}  // namespace mixstage
