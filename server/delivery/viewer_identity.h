// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/watch/text_message.h"
#include "server/delivery/secret.h"

namespace mixstage {

// Who is at the other end, after the login of SPEC.md 4.4.
struct ViewerIdentity {
  std::string name{};  // of the token; empty where no login is asked for
  WatchRole role = WatchRole::kViewer;
  Sha256 token_sha256{};  // which token it was; zeros where none was
  bool operator==(const ViewerIdentity&) const = default;
};

}  // namespace mixstage
