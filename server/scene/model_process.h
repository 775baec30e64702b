// SPDX-License-Identifier: Apache-2.0
//
// Models of strangers are read in a process of their own, mixstage-import, that may be lost: what a file
// breaks there is one line for its author, and the show goes on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <stop_token>

#include "proto/base/result.h"
#include "server/scene/model_file.h"

namespace mixstage {

struct ModelProcessConfig {
  std::filesystem::path program{};  // empty: mixstage-import beside this program, or a folder up
  std::uint64_t memory_bytes = std::uint64_t{2} << 30;
  int seconds = 20;  // of wall time, and of CPU time
};

// LoadModel in a process of its own that can read the model's folder and nothing else, write nothing and open
// no connection (confine.h). Waits for it; any thread, several at once. Fails as LoadModel does, and with one
// line too (kBadInput) when the file takes more memory or time than that, or crashes the importer;
// kUnavailable when the program is missing or was stopped.
Result<LoadedModel> LoadModelApart(const std::filesystem::path& file, const ModelProcessConfig& config = {},
                                   const std::stop_token& stop = {});

}  // namespace mixstage
