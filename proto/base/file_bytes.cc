// SPDX-License-Identifier: Apache-2.0
#include "proto/base/file_bytes.h"

#include <fstream>
#include <string>

namespace mixstage {

Result<std::vector<std::uint8_t>> ReadFileBytes(const std::filesystem::path& file,
                                                std::uintmax_t limit_bytes) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) {
    return Fail(ErrorCode::kBadInput, "is missing or not a regular file");
  }
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (error) return Fail(ErrorCode::kBadInput, "cannot be read: " + error.message());
  if (size > limit_bytes) {
    return Fail(ErrorCode::kBadInput, "has " + std::to_string(size) + " bytes, more than the limit of " +
                                          std::to_string(limit_bytes));
  }
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  std::ifstream in(file, std::ios::binary);
  if (!in || !in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()))) {
    return Fail(ErrorCode::kBadInput, "cannot be read");
  }
  return bytes;
}

}  // namespace mixstage
