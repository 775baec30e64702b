// SPDX-License-Identifier: Apache-2.0
//
// Fields out of JSON that strangers sent: every read checks type and range; the first failure stays and names
// its field. Private to proto/watch.
#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

using JsonFields = nlohmann::json;

// JSON nested at most 8 deep; anything else gives a discarded value, which has no fields. Does not throw.
[[nodiscard]] nlohmann::json ParseBoundedJson(std::string_view text);

// Every field that is read is required. After a failure the following reads do nothing.
class JsonReader {
 public:
  explicit JsonReader(const nlohmann::json& object);

  void Int(const std::string& name, int min, int max, int* out);
  void Int64(const std::string& name, std::int64_t* out);   // within +-2^53
  void Count(const std::string& name, std::uint64_t* out);  // 0..2^53
  void Double(const std::string& name, double* out);        // finite
  void Bool(const std::string& name, bool* out);
  void Text(const std::string& name, std::string* out);  // at most 1,024 bytes
  void List(const std::string& name, std::size_t max_items, const nlohmann::json** out);
  void Object(const std::string& name, const nlohmann::json** out);
  void Numbers(const std::string& name, std::span<double> out);  // as many as out has, each finite
  // One of the names: its place among them (0 after a failure).
  std::size_t Choice(const std::string& name, std::span<const char* const> choices);
  std::size_t Choice(const std::string& name, std::initializer_list<const char*> choices) {
    return Choice(name, std::span<const char* const>(choices.begin(), choices.size()));
  }
  // Whether there is such a field: for those that may be left out.
  [[nodiscard]] bool Has(const std::string& name) const;
  void Refuse(const std::string& name, const char* reason);

  [[nodiscard]] const Status& status() const { return status_; }

 private:
  // The field, or nothing when it is missing or an earlier one failed.
  const nlohmann::json* Find(const std::string& name);

  const nlohmann::json& object_;
  Status status_;
};

}  // namespace mixstage
