// SPDX-License-Identifier: Apache-2.0
//
// One connection's bytes, plain or under TLS, as one type: what reads and writes them need not know which. An
// AsyncStream in Asio's and Beast's sense. Private to the gateway; everything on its `serve` thread.
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/core/stream_traits.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/ssl/ssl_stream.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <utility>
#include <variant>

namespace mixstage {

class SocketStream {
 public:
  using Plain = boost::beast::tcp_stream;
  using Tls = boost::beast::ssl_stream<boost::beast::tcp_stream>;
  using executor_type = Plain::executor_type;

  explicit SocketStream(boost::asio::ip::tcp::socket socket)
      : stream_(std::in_place_type<Plain>, std::move(socket)) {}
  // The context may go before the stream does: OpenSSL counts its uses.
  SocketStream(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context& tls)
      : stream_(std::in_place_type<Tls>, std::move(socket), tls) {}

  [[nodiscard]] bool secure() const { return std::holds_alternative<Tls>(stream_); }
  // Timeouts, addresses and the hard end of it all.
  [[nodiscard]] Plain& tcp() {
    return std::visit([](auto& stream) -> Plain& { return boost::beast::get_lowest_layer(stream); }, stream_);
  }
  [[nodiscard]] executor_type get_executor() { return tcp().get_executor(); }

  // TLS's handshake; done(error) at once where there is none.
  template <typename Done>
  void Handshake(Done&& done) {
    if (auto* tls = std::get_if<Tls>(&stream_)) {
      tls->async_handshake(boost::asio::ssl::stream_base::server, std::forward<Done>(done));
    } else {
      done(boost::system::error_code{});
    }
  }
  // Says that no more bytes will be sent; done(error) when that is out.
  template <typename Done>
  void ShutdownSend(Done&& done) {
    if (auto* tls = std::get_if<Tls>(&stream_)) {
      tls->async_shutdown(std::forward<Done>(done));
    } else {
      boost::system::error_code error;
      tcp().socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, error);
      done(error);
    }
  }

  template <typename Buffers, typename Handler>
  auto async_read_some(const Buffers& buffers, Handler&& handler) {
    return std::visit(
        [&](auto& stream) { return stream.async_read_some(buffers, std::forward<Handler>(handler)); },
        stream_);
  }
  template <typename Buffers, typename Handler>
  auto async_write_some(const Buffers& buffers, Handler&& handler) {
    return std::visit(
        [&](auto& stream) { return stream.async_write_some(buffers, std::forward<Handler>(handler)); },
        stream_);
  }

 private:
  // What Beast's WebSocket does to its lowest layer, found by argument: close it now, and end it with
  // its own goodbye (TLS's close_notify) after WebSocket's.
  friend void beast_close_socket(SocketStream& stream) { stream.tcp().close(); }
  template <typename Handler>
  friend void async_teardown(boost::beast::role_type role, SocketStream& stream, Handler&& handler) {
    std::visit(
        [&](auto& s) {
          using boost::beast::websocket::async_teardown;
          async_teardown(role, s, std::forward<Handler>(handler));
        },
        stream.stream_);
  }

  std::variant<Plain, Tls> stream_;
};

}  // namespace mixstage
