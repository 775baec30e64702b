// SPDX-License-Identifier: Apache-2.0
//
// Who may reach the gateway. There is no login and no TLS yet, so only this machine: loopback addresses to
// listen on, loopback names to be called by (a page of elsewhere whose name resolves to 127.0.0.1 calls
// itself by that name), and of browsers only the gateway's own page.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

struct ListenAddress {
  std::string ip;  // "127.0.0.1", "::1"
  std::uint16_t port = 0;
};

// "127.0.0.1:8090", "localhost:8090", "[::1]:8090"; port 0 = any free one. Fails (kInvalidConfig) on other
// forms and on addresses that are not loopback, with the reason.
Result<ListenAddress> ParseListenAddress(const std::string& text);

// A Host header's value ("localhost:8090") names this machine: localhost, 127.a.b.c or [::1], any port.
[[nodiscard]] bool IsLoopbackHost(std::string_view host);

// An Origin header's value is the page that the same Host serves: "http://" + host, letter case aside.
[[nodiscard]] bool IsOwnOrigin(std::string_view origin, std::string_view host);

}  // namespace mixstage
