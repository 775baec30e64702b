// SPDX-License-Identifier: Apache-2.0
//
// Errors of the world (bytes from the wire, files, devices, configuration) are values: Result<T> and Status.
// A bug of ours is MIX_CHECK (check.h); a normal absence (a hole, a late frame) is part of the type.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace mixstage {

enum class ErrorCode {
  kInvalidConfig = 1,  // a person's configuration or command line: exit code 2
  kBadInput,           // a file or message that cannot be used: exit code 3
  kUnavailable,        // a device, port or network that is not there (now)
  kQualityGate,        // a result below its gate: exit code 4
  kInternal,           // a library refused what should have worked
};

struct Error {
  ErrorCode code = ErrorCode::kInternal;
  std::string message;  // one sentence a person can act on; callers put the place in front with Within()
};

template <typename T>
using Result = tl::expected<T, Error>;
using Status = tl::expected<void, Error>;

[[nodiscard]] inline tl::unexpected<Error> Fail(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

// Puts where it happened in front of what happened: "rig.json: cameras.color.fx is NaN".
[[nodiscard]] inline tl::unexpected<Error> Within(const std::string& place, Error error) {
  error.message = place + ": " + error.message;
  return tl::unexpected<Error>(std::move(error));
}

// Process exit code of an error (0 done, 2 usage or configuration, 3 unusable input, 4 quality gate, 1 else).
[[nodiscard]] inline int ExitCode(const Error& error) {
  switch (error.code) {
    case ErrorCode::kInvalidConfig:
      return 2;
    case ErrorCode::kBadInput:
      return 3;
    case ErrorCode::kQualityGate:
      return 4;
    case ErrorCode::kUnavailable:
    case ErrorCode::kInternal:
      break;
  }
  return 1;
}

}  // namespace mixstage
