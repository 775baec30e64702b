// SPDX-License-Identifier: Apache-2.0
//
// A WebSocket and HTTP client for tests of the gateway, plain and by TLS (whose certificate it takes as it
// is): every wait ends after ten seconds, by failing.
#pragma once

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

namespace mixstage {

inline constexpr std::chrono::seconds kTestPatience(10);

// True as soon as the condition is, false when patience is over.
template <typename Condition>
bool Eventually(const Condition& condition) {
  const auto end = std::chrono::steady_clock::now() + kTestPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

struct Received {
  bool text = false;
  std::string bytes;
};

using PlainStream = boost::asio::ip::tcp::socket;
using TlsStream = boost::asio::ssl::stream<boost::asio::ip::tcp::socket>;

template <typename Stream>
class BasicTestViewer {
 public:
  struct Options {
    std::string origin{};          // empty = none is sent
    int receive_buffer_bytes = 0;  // 0 = the system's
    std::string ticket{};          // empty = none is sent
  };

  explicit BasicTestViewer(std::uint16_t port) : BasicTestViewer(port, Options()) {}
  BasicTestViewer(std::uint16_t port, const Options& options) {
    using boost::asio::ip::tcp;
    namespace websocket = boost::beast::websocket;
    auto& socket = boost::beast::get_lowest_layer(websocket_);
    socket.open(tcp::v4());
    if (options.receive_buffer_bytes > 0) {
      socket.set_option(boost::asio::socket_base::receive_buffer_size(options.receive_buffer_bytes));
    }
    socket.connect({boost::asio::ip::make_address("127.0.0.1"), port});
    if constexpr (std::is_same_v<Stream, TlsStream>) {
      Wait([&](auto done) { websocket_.next_layer().async_handshake(TlsStream::client, done); });
      if (error_) return;
    }
    websocket_.set_option(websocket::stream_base::decorator([options](websocket::request_type& request) {
      if (!options.origin.empty()) request.set(boost::beast::http::field::origin, options.origin);
    }));
    websocket_.read_message_max(16 << 20);
    const std::string host = "127.0.0.1:" + std::to_string(port);
    Wait([&](auto done) { websocket_.async_handshake(response_, host, "/watch", done); });
    if (!error_ && !options.ticket.empty())
      SendText(R"({"type":"ticket","ticket":")" + options.ticket + "\"}");
  }

  [[nodiscard]] bool connected() const { return !error_; }
  [[nodiscard]] int http_status() const { return static_cast<int>(response_.result_int()); }

  // The next message; nothing when the server closed (close_code() says how) or sent nothing in time.
  std::optional<Received> Read() {
    boost::beast::flat_buffer buffer;
    Wait([&](auto done) {
      websocket_.async_read(buffer, [done](boost::system::error_code error, std::size_t) { done(error); });
    });
    if (error_) return std::nullopt;
    return Received{websocket_.got_text(), boost::beast::buffers_to_string(buffer.data())};
  }
  // Skips what is not wanted.
  template <typename Wanted>
  std::optional<Received> ReadUntil(const Wanted& wanted) {
    for (int i = 0; i < 100'000; ++i) {
      std::optional<Received> received = Read();
      if (!received || wanted(*received)) return received;
    }
    return std::nullopt;
  }
  std::optional<Received> ReadBinary() {
    return ReadUntil([](const Received& received) { return !received.text; });
  }
  std::optional<Received> ReadText(const std::string& with) {
    return ReadUntil([&](const Received& r) { return r.text && r.bytes.find(with) != std::string::npos; });
  }
  // Until the server closes: WebSocket's close code, 0 where the connection just broke.
  int ReadCloseCode() {
    while (Read()) {
    }
    return websocket_.reason().code;
  }
  // False when the connection does not take it any more.
  bool Send(const std::string& bytes, bool text) {
    websocket_.text(text);
    Wait([&](auto done) {
      websocket_.async_write(boost::asio::buffer(bytes),
                             [done](boost::system::error_code error, std::size_t) { done(error); });
    });
    return !error_;
  }
  bool SendText(const std::string& text) { return Send(text, true); }

 private:
  template <typename Start>
  void Wait(const Start& start) {
    error_ = boost::asio::error::would_block;
    start([this](boost::system::error_code error) { error_ = error; });
    io_.restart();
    const auto end = std::chrono::steady_clock::now() + kTestPatience;
    while (error_ == boost::asio::error::would_block && std::chrono::steady_clock::now() < end) {
      if (io_.run_one_until(end) == 0) break;
    }
  }

  static auto MakeStream(boost::asio::io_context& io, boost::asio::ssl::context& tls) {
    using WebSocket = boost::beast::websocket::stream<Stream>;
    if constexpr (std::is_same_v<Stream, TlsStream>) {
      return WebSocket(io, tls);
    } else {
      return WebSocket(io);
    }
  }

  boost::asio::io_context io_;
  boost::asio::ssl::context tls_{boost::asio::ssl::context::tls_client};
  boost::beast::websocket::stream<Stream> websocket_ = MakeStream(io_, tls_);
  boost::beast::websocket::response_type response_;
  boost::system::error_code error_;
};

using TestViewer = BasicTestViewer<PlainStream>;
using TlsTestViewer = BasicTestViewer<TlsStream>;

// Sends the bytes as they are and returns all that comes until the server closes.
inline std::string RawRequest(std::uint16_t port, const std::string& request) {
  using boost::asio::ip::tcp;
  boost::asio::io_context io;
  tcp::socket socket(io);
  boost::system::error_code error;
  socket.connect({boost::asio::ip::make_address("127.0.0.1"), port}, error);
  if (error) return "";
  boost::asio::write(socket, boost::asio::buffer(request), error);
  std::string response;
  boost::asio::async_read(socket, boost::asio::dynamic_buffer(response),
                          [](boost::system::error_code, std::size_t) {});
  io.run_for(kTestPatience);
  return response;
}

// The same by TLS; empty where the handshake fails.
inline std::string TlsRequest(std::uint16_t port, const std::string& request) {
  boost::asio::io_context io;
  boost::asio::ssl::context tls(boost::asio::ssl::context::tls_client);
  TlsStream stream(io, tls);
  boost::system::error_code error;
  stream.next_layer().connect({boost::asio::ip::make_address("127.0.0.1"), port}, error);
  if (!error) stream.handshake(TlsStream::client, error);
  if (error) return "";
  boost::asio::write(stream, boost::asio::buffer(request), error);
  std::string response;
  boost::asio::async_read(stream, boost::asio::dynamic_buffer(response),
                          [](boost::system::error_code, std::size_t) {});
  io.run_for(kTestPatience);
  return response;
}

inline std::string HttpGet(std::uint16_t port, const std::string& target,
                           const std::string& more_headers = "") {
  return RawRequest(port, "GET " + target + " HTTP/1.1\r\nHost: localhost:" + std::to_string(port) +
                              "\r\nConnection: close\r\n" + more_headers + "\r\n");
}

}  // namespace mixstage
