// SPDX-License-Identifier: Apache-2.0
//
// Addresses and names that the gateway is reached by. It answers to names that are its own only: a page of
// elsewhere whose name was made to resolve here (DNS rebinding) still calls itself by that name.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

struct ListenAddress {
  std::string ip;  // "127.0.0.1", "::1", "0.0.0.0"
  std::uint16_t port = 0;
  bool loopback = false;  // only this machine reaches it
};

// "127.0.0.1:8090", "localhost:8090", "[::1]:8090", "0.0.0.0:443"; port 0 = any free one. Fails
// (kInvalidConfig) on other forms, names but localhost included, with the reason.
Result<ListenAddress> ParseListenAddress(const std::string& text);

// A Host header's value ("localhost:8090") names this machine: localhost, 127.a.b.c or [::1], any port.
[[nodiscard]] bool IsLoopbackHost(std::string_view host);

// A Host header's value is one of `names` (lower case, without ports), any port; "*.example" stands for names
// that have one label more.
[[nodiscard]] bool IsHostAmong(std::string_view host, std::span<const std::string> names);

// An Origin header's value is the page that the same Host serves: scheme ("https://") + host, letter case
// aside.
[[nodiscard]] bool IsOwnOrigin(std::string_view origin, std::string_view scheme, std::string_view host);

// "https://studio.example", "http://localhost:5173": what a browser writes, lower case, without a path.
[[nodiscard]] bool IsOrigin(std::string_view text);

}  // namespace mixstage
