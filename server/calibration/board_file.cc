// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_file.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "proto/base/file_bytes.h"

namespace mixstage {
namespace {

using Json = nlohmann::json;

constexpr std::uintmax_t kMaxBoardBytes = 1 << 20;
constexpr std::size_t kMaxBoards = 16;

tl::unexpected<Error> Bad(const std::string& what) { return Fail(ErrorCode::kBadInput, what); }

Result<double> Length(const Json& j, const char* key, bool required) {
  if (!j.contains(key)) {
    if (!required) return 0.0;
    return Bad(std::string(key) + " is missing");
  }
  if (!j[key].is_number()) return Bad(std::string(key) + " is not a number");
  const double value = j[key].get<double>();
  if (!std::isfinite(value) || value < 0 || (required && value == 0) || value > 10)
    return Bad(std::string(key) + " is outside 0..10 m");
  return value;
}

Result<Board> ParseBoard(const Json& j) {
  Board board;
  if (!j.is_object()) return Bad("is not an object");
  if (j.contains("name")) {
    if (!j["name"].is_string()) return Bad("name is not a text");
    board.name = j["name"].get<std::string>();
  }
  if (j.contains("pattern") && j["pattern"] != "checkerboard") return Bad("pattern is not \"checkerboard\"");
  if (!j.contains("inner_corners") || !j["inner_corners"].is_array() || j["inner_corners"].size() != 2 ||
      !j["inner_corners"][0].is_number_integer() || !j["inner_corners"][1].is_number_integer()) {
    return Bad("inner_corners is not [columns, rows]");
  }
  const auto columns = j["inner_corners"][0].get<long long>();
  const auto rows = j["inner_corners"][1].get<long long>();
  if (columns < 3 || rows < 3 || columns > 100 || rows > 100)
    return Bad("inner_corners has a count outside 3..100");
  board.columns = static_cast<int>(columns);
  board.rows = static_cast<int>(rows);
  auto square = Length(j, "square_m", true);
  if (!square) return tl::unexpected(square.error());
  auto margin = Length(j, "white_margin_m", false);
  if (!margin) return tl::unexpected(margin.error());
  board.square_m = *square;
  board.white_margin_m = *margin;
  return board;
}

}  // namespace

Result<std::vector<Board>> ParseBoards(const std::string& json_text) {
  const Json root = Json::parse(json_text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded()) return Bad("is not JSON");
  const Json list = root.is_array() ? root : Json::array({root});
  if (list.empty() || list.size() > kMaxBoards) return Bad("holds no board, or more than 16");
  std::vector<Board> boards;
  for (std::size_t i = 0; i < list.size(); ++i) {
    auto board = ParseBoard(list[i]);
    if (!board) return Within("board " + std::to_string(i), board.error());
    if (board->name.empty()) board->name = list.size() == 1 ? "board" : "board " + std::to_string(i);
    const bool twice = std::any_of(boards.begin(), boards.end(), [&](const Board& b) {
      return std::minmax(b.columns, b.rows) == std::minmax(board->columns, board->rows);
    });
    if (twice)
      return Bad("board " + std::to_string(i) +
                 ": has the inner_corners of another: give them different counts");
    boards.push_back(std::move(*board));
  }
  return boards;
}

Result<std::vector<Board>> LoadBoards(const std::filesystem::path& file) {
  auto bytes = ReadFileBytes(file, kMaxBoardBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  auto boards = ParseBoards(std::string(bytes->begin(), bytes->end()));
  if (!boards) return Within(file.string(), boards.error());
  return boards;
}

}  // namespace mixstage
