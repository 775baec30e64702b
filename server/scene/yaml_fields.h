// SPDX-License-Identifier: Apache-2.0
//
// Reading a YAML mapping field by field: every key that is asked for is known, what is left over is an error,
// and every message carries file, line and the key's path.
#pragma once

#include <yaml-cpp/yaml.h>

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

class YamlFields {
 public:
  static constexpr std::size_t kLongestText = 512;  // characters

  // place: the file's name; path: the keys that lead here ("objects[2]"), empty at the top.
  YamlFields(const YAML::Node& map, std::string place, std::string path);

  // Fails when the node is no mapping, has more than 64 keys, or one of them twice.
  Status CheckShape() const;

  bool Has(const char* key);
  YAML::Node Raw(const char* key) { return Has(key) ? YAML::Node(map_[key]) : YAML::Node(); }

  // Each leaves the value alone when the key is missing, and fails when it is of another kind or not finite.
  Status Number(const char* key, double& value);
  Status NumberIn(const char* key, double low, double high, double& value);
  Status Flag(const char* key, bool& value);
  Status Text(const char* key, std::string& value);  // 1 to kLongestText characters
  Status NumberList(const char* key, std::vector<double>& values, std::size_t low, std::size_t high);
  template <std::size_t N>
  Status Numbers(const char* key, std::array<double, N>& values) {
    std::vector<double> list(values.begin(), values.end());
    if (auto ok = NumberList(key, list, N, N); !ok) return ok;
    std::copy(list.begin(), list.end(), values.begin());
    return {};
  }
  // One of the names; index is set to its place in the list.
  Status Choice(const char* key, std::initializer_list<std::string_view> names, std::size_t& index);

  // The mapping under a key that is there.
  Result<YamlFields> Map(const char* key);
  // The entries of a list of mappings, at most limit.
  Result<std::vector<YamlFields>> List(const char* key, std::size_t limit);

  // Fails for the first key that nobody asked for.
  Status CheckAllKnown() const;

  [[nodiscard]] tl::unexpected<Error> Bad(const char* key, const std::string& why) const;
  [[nodiscard]] int line() const { return Line(map_); }
  [[nodiscard]] static int Line(const YAML::Node& node) { return node.Mark().line + 1; }

 private:
  [[nodiscard]] std::string At(int line) const { return place_ + ":" + std::to_string(line) + ": "; }
  [[nodiscard]] std::string Path(const std::string& key) const {
    return path_.empty() ? key : path_ + "." + key;
  }

  YAML::Node map_;
  std::string place_, path_;
  std::vector<std::string> known_;
};

// Text to its root mapping; a syntax error names its line. No exception leaves.
Result<YamlFields> ParseYaml(const std::string& text, const std::string& place);

// A plain number; nothing for anything else ("nan", "inf", "1 m", a list).
bool YamlNumber(const YAML::Node& node, double& value);

}  // namespace mixstage
