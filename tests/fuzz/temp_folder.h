// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>

#include "proto/base/check.h"

namespace mixstage {

// A folder of one fuzzer process, gone with it.
class TempFolder {
 public:
  TempFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "mixstage_fuzz_XXXXXX").string();
    MIX_CHECK(mkdtemp(name.data()) != nullptr);
    place = name;
  }
  ~TempFolder() { std::filesystem::remove_all(place); }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  void Write(const char* name, std::span<const std::uint8_t> bytes) const {
    std::ofstream(place / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  }

  std::filesystem::path place;
};

}  // namespace mixstage
