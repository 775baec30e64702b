// SPDX-License-Identifier: Apache-2.0
//
// Checkerboards as board.json states them (SPEC.md 5.1).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/board.h"

namespace mixstage {

// One board or a list of them. Fails (kBadInput, the field named) on another pattern than "checkerboard",
// counts outside 3..100, sizes that are not finite and positive, and two boards with the same counts (they
// could not be told apart).
Result<std::vector<Board>> ParseBoards(const std::string& json_text);
Result<std::vector<Board>> LoadBoards(const std::filesystem::path& file);

}  // namespace mixstage
