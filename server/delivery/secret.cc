// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/secret.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <sys/random.h>

#include <algorithm>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr std::string_view kBase64Url = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";

int HexValue(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

}  // namespace

Result<std::string> MakeSecret() {
  std::array<std::uint8_t, 32> bytes{};
  // Up to 256 bytes are never cut short once the generator is seeded.
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return Fail(ErrorCode::kInternal, "the system gives no random numbers (getrandom)");
  }
  std::string text;
  std::uint32_t bits = 0;
  int waiting = 0;
  for (const std::uint8_t byte : bytes) {
    bits = bits << 8 | byte;
    for (waiting += 8; waiting >= 6; waiting -= 6) text += kBase64Url[bits >> (waiting - 6) & 63];
  }
  text += kBase64Url[bits << (6 - waiting) & 63];
  OPENSSL_cleanse(bytes.data(), bytes.size());
  return text;
}

bool IsSecret(std::string_view text) {
  return text.size() == kSecretCharacters && text.find_first_not_of(kBase64Url) == std::string_view::npos;
}

Sha256 DigestOf(std::string_view secret) {
  Sha256 digest{};
  MIX_CHECK(EVP_Digest(secret.data(), secret.size(), digest.data(), nullptr, EVP_sha256(), nullptr) == 1);
  return digest;
}

std::string ToHex(const Sha256& digest) {
  std::string hex;
  for (const std::uint8_t byte : digest) {
    hex += "0123456789abcdef"[byte >> 4];
    hex += "0123456789abcdef"[byte & 15];
  }
  return hex;
}

std::optional<Sha256> FromHex(std::string_view hex) {
  Sha256 digest{};
  if (hex.size() != 2 * digest.size()) return std::nullopt;
  for (std::size_t i = 0; i < digest.size(); ++i) {
    const int high = HexValue(hex[2 * i]), low = HexValue(hex[2 * i + 1]);
    if (high < 0 || low < 0) return std::nullopt;
    digest[i] = static_cast<std::uint8_t>(high << 4 | low);
  }
  return digest;
}

std::optional<std::size_t> FindDigest(std::span<const Sha256> digests, const Sha256& wanted) {
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < digests.size(); ++i) {
    if (CRYPTO_memcmp(digests[i].data(), wanted.data(), wanted.size()) == 0) found = i;
  }
  return found;
}

}  // namespace mixstage
