// SPDX-License-Identifier: Apache-2.0
//
// One HTTP/1.1 connection: the page, /healthz, /metrics, the login, and the step up to a WebSocket. Private
// to the gateway; everything on its `serve` thread.
#pragma once

#include <boost/asio/ip/address.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "server/delivery/access_control.h"
#include "server/delivery/connection_slot.h"
#include "server/delivery/page_files.h"
#include "server/delivery/socket_stream.h"
#include "server/delivery/viewer_hub.h"

namespace mixstage {

// What requests are answered from; outlives the connections.
struct HttpContent {
  PageFiles pages;
  std::function<std::string()> metrics;
};

class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(SocketStream stream, ConnectionSlot slot, const HttpContent& content, AccessControl& access,
                 ViewerHub& hub);
  // TLS's handshake, then requests.
  void Start();

 private:
  using Request = boost::beast::http::request<boost::beast::http::empty_body>;
  struct Reply {
    boost::beast::http::status status = boost::beast::http::status::ok;
    std::string_view mime_type = "text/plain; charset=utf-8";
    std::string_view cache_control = "no-store";
    std::string own_content{};                                               // made for this answer, or
    const std::string* content = nullptr;                                    // the page's
    boost::beast::http::field further = boost::beast::http::field::unknown;  // one more header, or none
    std::string_view further_value{};
  };

  void Read();
  void OnRead(boost::system::error_code error);
  [[nodiscard]] Reply Answer(const Request& request, bool* upgrade);
  [[nodiscard]] Reply LogIn(const Request& request);
  [[nodiscard]] Reply Get(const Request& request, std::string_view path);
  [[nodiscard]] bool MayReadMetrics(const Request& request);
  void Send(const Request& request, Reply reply);

  SocketStream stream_;
  const boost::asio::ip::address address_;  // of the other end
  ConnectionSlot slot_;
  const HttpContent& content_;
  AccessControl& access_;
  ViewerHub& hub_;
  boost::beast::flat_buffer buffer_;
  std::optional<boost::beast::http::request_parser<boost::beast::http::empty_body>> parser_;
};

}  // namespace mixstage
