// SPDX-License-Identifier: Apache-2.0
#include "server/scene/yaml_fields.h"

#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <sstream>

namespace mixstage {
namespace {

constexpr std::size_t kMostKeys = 64;

// Parses and keeps nothing.
class NoEvents final : public YAML::EventHandler {
 public:
  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t, const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override {
  }
  void OnMapEnd() override {}
};

// Not by YAML::LoadAll: of a comma outside brackets it makes empty documents without end.
bool IsOneDocument(const std::string& text) {
  std::istringstream stream(text);
  YAML::Parser parser(stream);
  NoEvents nothing;
  return parser.HandleNextDocument(nothing) && !parser.HandleNextDocument(nothing);
}

}  // namespace

bool YamlNumber(const YAML::Node& node, double& value) {
  if (!node.IsDefined() || !node.IsScalar()) return false;
  const std::string& text = node.Scalar();
  const std::size_t sign = !text.empty() && text[0] == '+' ? 1 : 0;
  const auto [end, error] = std::from_chars(text.data() + sign, text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

YamlFields::YamlFields(const YAML::Node& map, std::string place, std::string path)
    : map_(map), place_(std::move(place)), path_(std::move(path)) {}

Status YamlFields::CheckShape() const {
  const std::string name = path_.empty() ? "the file" : path_;
  if (!map_.IsMap()) return Fail(ErrorCode::kInvalidConfig, At(line()) + name + " is not a mapping of keys");
  if (map_.size() > kMostKeys)
    return Fail(ErrorCode::kInvalidConfig, At(line()) + name + " has more than 64 keys");
  std::set<std::string> keys;
  for (const auto& entry : map_) {
    if (!entry.first.IsScalar())
      return Fail(ErrorCode::kInvalidConfig, At(Line(entry.first)) + name + " has a key that is no name");
    if (!keys.insert(entry.first.Scalar()).second) {
      return Fail(ErrorCode::kInvalidConfig,
                  At(Line(entry.first)) + Path(entry.first.Scalar()) + " is given twice");
    }
  }
  return {};
}

bool YamlFields::Has(const char* key) {
  known_.emplace_back(key);
  return map_[key].IsDefined();
}

tl::unexpected<Error> YamlFields::Bad(const char* key, const std::string& why) const {
  const YAML::Node node = map_[key];
  return Fail(ErrorCode::kInvalidConfig, At(node.IsDefined() ? Line(node) : line()) + Path(key) + " " + why);
}

Status YamlFields::Number(const char* key, double& value) {
  if (!Has(key)) return {};
  if (!YamlNumber(map_[key], value)) return Bad(key, "is not a finite number");
  return {};
}

Status YamlFields::NumberIn(const char* key, double low, double high, double& value) {
  if (auto ok = Number(key, value); !ok) return ok;
  if (!(value >= low && value <= high)) {
    char range[80];
    std::snprintf(range, sizeof range, "is outside %g..%g", low, high);
    return Bad(key, range);
  }
  return {};
}

Status YamlFields::Flag(const char* key, bool& value) {
  if (!Has(key)) return {};
  const std::string text = map_[key].IsScalar() ? map_[key].Scalar() : "";
  if (text != "true" && text != "false") return Bad(key, "is neither true nor false");
  value = text == "true";
  return {};
}

Status YamlFields::Text(const char* key, std::string& value) {
  if (!Has(key)) return {};
  const YAML::Node node = map_[key];
  if (!node.IsScalar() || node.Scalar().empty() || node.Scalar().size() > kLongestText) {
    return Bad(key, "is not a text of 1 to 512 characters");
  }
  value = node.Scalar();
  return {};
}

Status YamlFields::NumberList(const char* key, std::vector<double>& values, std::size_t low,
                              std::size_t high) {
  if (!Has(key)) return {};
  const YAML::Node node = map_[key];
  const bool fits = node.IsSequence() && node.size() >= low && node.size() <= high;
  if (!fits) {
    return Bad(key, "is not a list of " + std::to_string(low) +
                        (low == high ? "" : " to " + std::to_string(high)) + " numbers");
  }
  values.clear();
  for (const YAML::Node& entry : node) {
    double value = 0;
    if (!YamlNumber(entry, value)) {
      return Bad(key, "[" + std::to_string(values.size()) + "] is not a finite number");
    }
    values.push_back(value);
  }
  return {};
}

Status YamlFields::Choice(const char* key, std::initializer_list<std::string_view> names,
                          std::size_t& index) {
  if (!Has(key)) return {};
  const std::string text = map_[key].IsScalar() ? map_[key].Scalar() : "";
  const auto* found = std::find(names.begin(), names.end(), text);
  if (found == names.end()) {
    std::string all;
    for (const std::string_view name : names) all += (all.empty() ? "" : ", ") + std::string(name);
    return Bad(key, "is none of " + all);
  }
  index = static_cast<std::size_t>(found - names.begin());
  return {};
}

Result<YamlFields> YamlFields::Map(const char* key) {
  YamlFields map(Raw(key), place_, Path(key));
  if (auto ok = map.CheckShape(); !ok) return tl::unexpected(ok.error());
  return map;
}

Result<std::vector<YamlFields>> YamlFields::List(const char* key, std::size_t limit) {
  std::vector<YamlFields> entries;
  if (!Has(key) || map_[key].IsNull()) return entries;
  const YAML::Node list = map_[key];
  if (!list.IsSequence()) return Bad(key, "is not a list");
  if (list.size() > limit) return Bad(key, "has more than " + std::to_string(limit) + " entries");
  for (const YAML::Node& entry : list) {
    entries.emplace_back(entry, place_, Path(key) + "[" + std::to_string(entries.size()) + "]");
    if (auto ok = entries.back().CheckShape(); !ok) return tl::unexpected(ok.error());
  }
  return entries;
}

Status YamlFields::CheckAllKnown() const {
  for (const auto& entry : map_) {
    const std::string& key = entry.first.Scalar();
    if (std::find(known_.begin(), known_.end(), key) == known_.end()) {
      return Fail(ErrorCode::kInvalidConfig,
                  At(Line(entry.first)) + "unknown key " + Path(key.substr(0, 80)));
    }
  }
  return {};
}

Result<YamlFields> ParseYaml(const std::string& text, const std::string& place) {
  try {
    if (!IsOneDocument(text)) return Fail(ErrorCode::kInvalidConfig, place + ": is not one YAML document");
    YamlFields root(YAML::Load(text), place, "");
    if (auto ok = root.CheckShape(); !ok) return tl::unexpected(ok.error());
    return root;
  } catch (const YAML::Exception& e) {
    return Fail(ErrorCode::kInvalidConfig, place + ":" + std::to_string(e.mark.line + 1) + ": " + e.msg);
  } catch (const std::exception& e) {
    return Fail(ErrorCode::kInvalidConfig, place + ": cannot be read as YAML (" + e.what() + ")");
  }
}

}  // namespace mixstage
