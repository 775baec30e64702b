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

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

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
  for (const char c : host) parts.host += Lower(c);
  return parts;
}

// The address that is written, or localhost's. Names are not looked up: what a resolver says can change.
std::optional<boost::asio::ip::address> Ip(const std::string& host) {
  boost::system::error_code error;
  const auto address = boost::asio::ip::make_address(host == "localhost" ? "127.0.0.1" : host, error);
  if (error) return std::nullopt;
  return address;
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
  const auto ip = Ip(parts->host);
  if (!ip) return refuse("has no numeric address, like 127.0.0.1, 0.0.0.0 or [::]");
  address.ip = ip->to_string();
  address.loopback = ip->is_loopback();
  return address;
}

bool IsLoopbackHost(std::string_view host) {
  const std::optional<HostAndPort> parts = Split(host);
  if (!parts) return false;
  const auto ip = Ip(parts->host);
  return ip && ip->is_loopback();
}

bool IsHostAmong(std::string_view host, std::span<const std::string> names) {
  const std::optional<HostAndPort> parts = Split(host);
  if (!parts || parts->host.empty()) return false;
  const std::size_t dot = parts->host.find('.');
  return std::ranges::any_of(names, [&](const std::string& name) {
    if (name == parts->host) return true;
    return name.starts_with("*.") && dot != std::string::npos && dot > 0 &&
           name.substr(1) == parts->host.substr(dot);
  });
}

bool IsOwnOrigin(std::string_view origin, std::string_view scheme, std::string_view host) {
  if (origin.size() != scheme.size() + host.size()) return false;
  const auto same = [](char a, char b) { return Lower(a) == Lower(b); };
  return std::equal(scheme.begin(), scheme.end(), origin.begin(), same) &&
         std::equal(host.begin(), host.end(), origin.begin() + static_cast<std::ptrdiff_t>(scheme.size()),
                    same);
}

bool IsOrigin(std::string_view text) {
  const std::size_t scheme = text.starts_with("https://") ? 8 : text.starts_with("http://") ? 7 : 0;
  if (scheme == 0 || text.size() == scheme || text.size() > 300) return false;
  return std::ranges::all_of(text.substr(scheme), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '.' || c == '-' || c == ':' || c == '[' ||
           c == ']';
  });
}

}  // namespace mixstage
