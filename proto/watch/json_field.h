// SPDX-License-Identifier: Apache-2.0
//
// Fields out of JSON that strangers sent: every read checks type and range; the first failure stays and names
// its field. Private to proto/watch.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

using JsonFields = nlohmann::json;

// JSON nested at most 8 deep; anything else gives a discarded value, which has no fields. Does not throw.
[[nodiscard]] nlohmann::json ParseBoundedJson(std::string_view text);

// Every field is required. After a failure the following reads do nothing.
class JsonReader {
 public:
  explicit JsonReader(const nlohmann::json& object);

  void Int(const std::string& name, int min, int max, int* out);
  void Int64(const std::string& name, std::int64_t* out);   // within +-2^53
  void Count(const std::string& name, std::uint64_t* out);  // 0..2^53
  void Double(const std::string& name, double* out);        // finite
  void Text(const std::string& name, std::string* out);     // at most 1,024 bytes
  void List(const std::string& name, std::size_t max_items, const nlohmann::json** out);
  void Object(const std::string& name, const nlohmann::json** out);

  [[nodiscard]] const Status& status() const { return status_; }

 private:
  // The field, or nothing when it is missing or an earlier one failed.
  const nlohmann::json* Find(const std::string& name);
  void Refuse(const std::string& name, const char* reason);

  const nlohmann::json& object_;
  Status status_;
};

}  // namespace mixstage
