// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/listen_address.h"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <charconv>
#include <optional>

namespace mixstage {
namespace {

struct HostAndPort {
  std::string host;
  std::string_view port;  // without the colon; empty = none
};

// "host", "host:port", "[v6]", "[v6]:port", in lower case and without the brackets.
std::optional<HostAndPort> Split(std::string_view text) {
  HostAndPort parts;
  std::string_view host = text;
  if (text.starts_with('[')) {
    const std::size_t end = text.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    host = text.substr(1, end - 1);
    const std::string_view rest = text.substr(end + 1);
    if (!rest.empty() && rest.front() != ':') return std::nullopt;
    if (!rest.empty()) parts.port = rest.substr(1);
  } else if (const std::size_t colon = text.rfind(':'); colon != std::string_view::npos) {
    host = text.substr(0, colon);
    parts.port = text.substr(colon + 1);
  }
  for (const char c : host) parts.host += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return parts;
}

// The loopback address of a name, or nothing. Names are not looked up: what a resolver says can change.
std::optional<std::string> LoopbackIp(const std::string& host) {
  if (host == "localhost") return "127.0.0.1";
  boost::system::error_code error;
  const auto address = boost::asio::ip::make_address(host, error);
  if (error || !address.is_loopback()) return std::nullopt;
  return address.to_string();
}

}  // namespace

Result<ListenAddress> ParseListenAddress(const std::string& text) {
  const auto refuse = [&text](const std::string& why) {
    return Fail(ErrorCode::kInvalidConfig, "listen address \"" + text + "\" " + why);
  };
  const std::optional<HostAndPort> parts = Split(text);
  if (!parts || parts->host.empty() || parts->port.empty())
    return refuse("is not ADDRESS:PORT, like 127.0.0.1:8090");
  ListenAddress address;
  const char* end = parts->port.data() + parts->port.size();
  const auto [rest, error] = std::from_chars(parts->port.data(), end, address.port);
  if (error != std::errc{} || rest != end) return refuse("has no port within 0..65535");
  const std::optional<std::string> ip = LoopbackIp(parts->host);
  if (!ip) {
    return refuse(
        "is not a loopback address: login and TLS are not there yet, so only this machine may watch (use "
        "127.0.0.1:PORT and, from elsewhere, an SSH tunnel)");
  }
  address.ip = *ip;
  return address;
}

bool IsLoopbackHost(std::string_view host) {
  const std::optional<HostAndPort> parts = Split(host);
  return parts && LoopbackIp(parts->host).has_value();
}

bool IsOwnOrigin(std::string_view origin, std::string_view host) {
  constexpr std::string_view kScheme = "http://";
  if (origin.size() != kScheme.size() + host.size()) return false;
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  const auto same = [lower](char a, char b) { return lower(a) == lower(b); };
  return std::equal(kScheme.begin(), kScheme.end(), origin.begin(), same) &&
         std::equal(host.begin(), host.end(), origin.begin() + kScheme.size(), same);
}

}  // namespace mixstage
