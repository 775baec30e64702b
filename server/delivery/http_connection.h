// SPDX-License-Identifier: Apache-2.0
//
// One HTTP/1.1 connection: the page, /healthz, /metrics, and the step up to a WebSocket. Private to the
// gateway; everything on its `serve` thread.
#pragma once

#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <string>

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
  HttpConnection(SocketStream stream, ConnectionSlot slot, const HttpContent& content, ViewerHub& hub);
  // TLS's handshake, then requests.
  void Start();

 private:
  using Request = boost::beast::http::request<boost::beast::http::empty_body>;
  struct Reply {
    boost::beast::http::status status = boost::beast::http::status::ok;
    std::string_view mime_type = "text/plain; charset=utf-8";
    std::string_view cache_control = "no-store";
    std::string own_content{};             // made for this answer, or
    const std::string* content = nullptr;  // the page's
  };

  void Read();
  void OnRead(boost::system::error_code error);
  [[nodiscard]] Reply Answer(const Request& request, bool* upgrade);
  [[nodiscard]] Reply Get(std::string_view path) const;
  void Send(const Request& request, Reply reply);

  SocketStream stream_;
  const std::string address_;  // of the other end
  ConnectionSlot slot_;
  const HttpContent& content_;
  ViewerHub& hub_;
  boost::beast::flat_buffer buffer_;
  std::optional<boost::beast::http::request_parser<boost::beast::http::empty_body>> parser_;
};

}  // namespace mixstage
