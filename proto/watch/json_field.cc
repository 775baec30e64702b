// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/json_field.h"

#include <cmath>

namespace mixstage {
namespace {

constexpr int kMaxDepth = 8;
constexpr std::size_t kMaxTextBytes = 1024;
// 2^53: JavaScript counts no further, and sums and differences of such numbers do not overflow.
constexpr double kLargestWhole = 9007199254740992.0;

// A whole number, written as 3 or as 3.0; nothing else (JavaScript has only doubles).
bool IsWhole(const nlohmann::json& value) {
  if (value.is_number_integer()) return true;
  if (!value.is_number_float()) return false;
  const double number = value.get<double>();
  return std::trunc(number) == number && std::abs(number) <= kLargestWhole;
}

}  // namespace

nlohmann::json ParseBoundedJson(std::string_view text) {
  // What lies deeper is thrown away while parsing and the whole refused afterwards.
  bool too_deep = false;
  const auto watch_depth = [&too_deep](int depth, nlohmann::json::parse_event_t, nlohmann::json&) {
    too_deep = too_deep || depth > kMaxDepth;
    return !too_deep;
  };
  nlohmann::json json = nlohmann::json::parse(text, watch_depth, /*allow_exceptions=*/false);
  if (too_deep) return nlohmann::json(nlohmann::json::value_t::discarded);
  return json;
}

JsonReader::JsonReader(const nlohmann::json& object) : object_(object) {
  if (object.is_discarded()) {
    status_ = Fail(ErrorCode::kBadInput, "is not JSON");
  } else if (!object.is_object()) {
    status_ = Fail(ErrorCode::kBadInput, "is not a JSON object");
  }
}

const nlohmann::json* JsonReader::Find(const std::string& name) {
  if (!status_) return nullptr;
  const auto it = object_.find(name);
  if (it == object_.end()) {
    Refuse(name, "is missing");
    return nullptr;
  }
  return &*it;
}

void JsonReader::Refuse(const std::string& name, const char* reason) {
  if (!status_) return;
  // A name can be a stranger's: it must not break a log line.
  std::string printable = name.substr(0, 64);
  for (char& c : printable) c = c > ' ' && c <= '~' && c != '"' ? c : '?';
  status_ = Fail(ErrorCode::kBadInput, printable + " " + reason);
}

void JsonReader::Int(const std::string& name, int min, int max, int* out) {
  std::int64_t value = 0;
  Int64(name, &value);
  if (!status_) return;
  if (value < min || value > max) return Refuse(name, "is out of range");
  *out = static_cast<int>(value);
}

void JsonReader::Int64(const std::string& name, std::int64_t* out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!IsWhole(*value)) return Refuse(name, "is not a whole number");
  if (!(std::abs(value->get<double>()) <= kLargestWhole)) return Refuse(name, "is out of range");
  *out = value->get<std::int64_t>();
}

void JsonReader::Count(const std::string& name, std::uint64_t* out) {
  std::int64_t value = 0;
  Int64(name, &value);
  if (!status_) return;
  if (value < 0) return Refuse(name, "is negative");
  *out = static_cast<std::uint64_t>(value);
}

void JsonReader::Double(const std::string& name, double* out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!value->is_number() || !std::isfinite(value->get<double>())) return Refuse(name, "is not a number");
  *out = value->get<double>();
}

void JsonReader::Bool(const std::string& name, bool* out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!value->is_boolean()) return Refuse(name, "is neither true nor false");
  *out = value->get<bool>();
}

void JsonReader::Text(const std::string& name, std::string* out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!value->is_string()) return Refuse(name, "is not a text");
  const auto& text = value->get_ref<const std::string&>();
  if (text.size() > kMaxTextBytes) return Refuse(name, "is longer than 1,024 bytes");
  *out = text;
}

void JsonReader::List(const std::string& name, std::size_t max_items, const nlohmann::json** out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!value->is_array()) return Refuse(name, "is not a list");
  if (value->size() > max_items) return Refuse(name, "has too many items");
  *out = value;
}

void JsonReader::Object(const std::string& name, const nlohmann::json** out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!value->is_object()) return Refuse(name, "is not an object");
  *out = value;
}

void JsonReader::Numbers(const std::string& name, std::span<double> out) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return;
  if (!value->is_array() || value->size() != out.size())
    return Refuse(name, "is not a list of as many numbers");
  for (std::size_t i = 0; i < out.size(); ++i) {
    const nlohmann::json& number = (*value)[i];
    if (!number.is_number() || !std::isfinite(number.get<double>())) {
      return Refuse(name, "holds something that is not a number");
    }
    out[i] = number.get<double>();
  }
}

std::size_t JsonReader::Choice(const std::string& name, std::span<const char* const> choices) {
  const nlohmann::json* value = Find(name);
  if (value == nullptr) return 0;
  for (std::size_t i = 0; value->is_string() && i < choices.size(); ++i) {
    if (value->get_ref<const std::string&>() == choices[i]) return i;
  }
  Refuse(name, "is none of the names that are known");
  return 0;
}

bool JsonReader::Has(const std::string& name) const { return status_ && object_.contains(name); }

}  // namespace mixstage
