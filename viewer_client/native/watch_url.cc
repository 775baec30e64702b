// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/watch_url.h"

#include <charconv>

namespace mixstage {

Result<WatchUrl> ParseWatchUrl(const std::string& url) {
  const auto refuse = [&url](const std::string& why) {
    return Fail(ErrorCode::kInvalidConfig, "\"" + url + "\" " + why + ", like http://localhost:8090/");
  };
  const std::size_t scheme_end = url.find("://");
  const std::string scheme = scheme_end == std::string::npos ? "" : url.substr(0, scheme_end);
  const bool tls = scheme == "https" || scheme == "wss";
  if (!tls && scheme != "http" && scheme != "ws") return refuse("is not the address of a page");
  std::string authority = url.substr(scheme_end + 3);
  authority = authority.substr(0, authority.find_first_of("/?#"));
  if (authority.find_first_of("@ \r\n\t\"") != std::string::npos)
    return refuse("has a host that is no name or address");
  const std::size_t bracket = authority.rfind(']');
  const std::size_t colon = authority.rfind(':');
  const bool has_port = colon != std::string::npos && (bracket == std::string::npos || colon > bracket);
  WatchUrl parsed;
  parsed.tls = tls;
  parsed.host = has_port ? authority.substr(0, colon) : authority;
  parsed.port = has_port ? authority.substr(colon + 1) : tls ? "443" : "80";
  parsed.host_header = authority;
  unsigned port = 0;
  const char* end = parsed.port.data() + parsed.port.size();
  const auto [rest, error] = std::from_chars(parsed.port.data(), end, port);
  if (error != std::errc{} || rest != end || port == 0 || port > 65535)
    return refuse("has no port within 1..65535");
  if (parsed.host.starts_with('[') && parsed.host.ends_with(']')) {
    parsed.host = parsed.host.substr(1, parsed.host.size() - 2);
  }
  if (parsed.host.empty()) return refuse("names no host");
  return parsed;
}

bool IsThisMachine(const WatchUrl& url) {
  // "127.evil.example" is a name, not an address.
  const bool digits = url.host.find_first_not_of("0123456789.") == std::string::npos;
  return url.host == "localhost" || url.host == "::1" || (digits && url.host.starts_with("127."));
}

}  // namespace mixstage
