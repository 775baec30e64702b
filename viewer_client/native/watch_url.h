// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/base/result.h"

namespace mixstage {

// Where a server is: what of a page's address matters to a viewer.
struct WatchUrl {
  bool tls = false;  // https, wss
  std::string host;  // without brackets
  std::string port;
  std::string host_header;
};

// http, ws, https and wss; path and query are not looked at. Fails (kInvalidConfig) on other schemes, an
// empty host, a bad port.
Result<WatchUrl> ParseWatchUrl(const std::string& url);

// Whether it is a loopback address by its own word; no name is looked up.
[[nodiscard]] bool IsThisMachine(const WatchUrl& url);

}  // namespace mixstage
