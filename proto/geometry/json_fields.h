// SPDX-License-Identifier: Apache-2.0
//
// Reading JSON of people field by field: what is wrong is said with the field's whole name, numbers are
// finite. Only for sources that link nlohmann_json.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/frames.h"

namespace mixstage {

// One JSON object being read: every key asked for is noted, so that what is left over can be warned about.
class JsonFields {
 public:
  JsonFields(const nlohmann::json& object, std::string path, std::vector<std::string>& warnings)
      : object_(object), path_(std::move(path)), warnings_(warnings) {}

  bool Has(const char* key) {
    known_.emplace_back(key);
    return object_.contains(key);
  }
  const nlohmann::json& Raw(const char* key) { return object_.at(key); }

  Status Number(const char* key, double& value) {
    if (!Has(key)) return {};
    const nlohmann::json& j = object_.at(key);
    if (!j.is_number() || !std::isfinite(j.get<double>())) return Bad(key, "is not a finite number");
    value = j.get<double>();
    return {};
  }
  Status Integer(const char* key, int& value) {
    double number = value;
    if (auto ok = Number(key, number); !ok) return ok;
    if (number != std::floor(number) || std::abs(number) > 1e6)
      return Bad(key, "is not a small whole number");
    value = static_cast<int>(number);
    return {};
  }
  template <std::size_t N>
  Status Numbers(const char* key, std::array<double, N>& values, bool& present) {
    present = Has(key);
    if (!present) return {};
    const nlohmann::json& j = object_.at(key);
    if (!j.is_array() || j.size() != N) return Bad(key, "is not a list of " + std::to_string(N) + " numbers");
    for (std::size_t i = 0; i < N; ++i) {
      if (!j[i].is_number() || !std::isfinite(j[i].get<double>()))
        return Bad(key, "has a number that is not finite");
      values[i] = j[i].get<double>();
    }
    return {};
  }
  Status Rigid(const char* key, RigidTransform& value) {
    std::array<double, 16> numbers{};
    bool present = false;
    if (auto ok = Numbers(key, numbers, present); !ok || !present) return ok;
    auto T = RigidFromRowMajor(numbers);
    if (!T) return Bad(key, T.error().message);
    value = *T;
    return {};
  }
  // Calls read(JsonFields&) for the object under key, when it is there.
  template <typename Read>
  Status Object(const char* key, Read read) {
    if (!Has(key)) return {};
    if (!object_.at(key).is_object()) return Bad(key, "is not an object");
    JsonFields inner(object_.at(key), path_.empty() ? key : path_ + "." + key, warnings_);
    if (Status ok = read(inner); !ok) return ok;
    inner.WarnOfUnknown();
    return {};
  }
  Status Text(const char* key, std::string& value) {
    if (!Has(key)) return {};
    const nlohmann::json& j = object_.at(key);
    if (!j.is_string() || j.get_ref<const std::string&>().size() > 200)
      return Bad(key, "is not a text of at most 200 bytes");
    value = j.get<std::string>();
    return {};
  }
  // One that must be there.
  Status Vector(const char* key, Eigen::Vector3d& value) {
    std::array<double, 3> numbers{};
    bool present = false;
    if (auto ok = Numbers(key, numbers, present); !ok) return ok;
    if (!present) return Bad(key, "is missing");
    value = Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
    return {};
  }
  // Calls read(JsonFields&) for every object of the list under key, when it is there.
  template <typename Read>
  Status List(const char* key, std::size_t most, Read read) {
    if (!Has(key)) return {};
    const nlohmann::json& list = object_.at(key);
    if (!list.is_array() || list.size() > most)
      return Bad(key, "is not a list of at most " + std::to_string(most) + " objects");
    for (std::size_t i = 0; i < list.size(); ++i) {
      const std::string place = (path_.empty() ? "" : path_ + ".") + key + "[" + std::to_string(i) + "]";
      if (!list[i].is_object()) return Fail(ErrorCode::kBadInput, place + " is not an object");
      JsonFields inner(list[i], place, warnings_);
      if (Status ok = read(inner); !ok) return ok;
      inner.WarnOfUnknown();
    }
    return {};
  }
  void WarnOfUnknown() {
    for (const auto& [key, unused] : object_.items()) {
      if (std::find(known_.begin(), known_.end(), key) == known_.end()) {
        warnings_.push_back("unknown key " + (path_.empty() ? key : path_ + "." + key) + " is ignored");
      }
    }
  }
  Status Bad(const char* key, const std::string& why) const {
    return Fail(ErrorCode::kBadInput, (path_.empty() ? "" : path_ + ".") + key + " " + why);
  }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  const nlohmann::json& object_;
  std::string path_;
  std::vector<std::string>& warnings_;
  std::vector<std::string> known_;
};

// Runs the steps in order and stops at the first that fails.
inline Status All(std::initializer_list<Status> steps) {
  for (const Status& step : steps) {
    if (!step) return step;
  }
  return {};
}

}  // namespace mixstage
