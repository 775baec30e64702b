// SPDX-License-Identifier: Apache-2.0
//
// Private to viewer_client/native.
#pragma once

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <deque>
#include <string>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "viewer_client/native/dialer.h"
#include "viewer_client/native/server_clock.h"
#include "viewer_client/native/watch_client.h"

namespace mixstage {

// One connection from resolve to its end. Lives in one io_context, which one thread runs.
template <typename Stream>
class WatchSession {
 public:
  // ticket: of a login; empty = none.
  WatchSession(boost::asio::io_context& io, const WatchClientConfig& config, const DialPlan& plan,
               std::string ticket, const WatchCallbacks& callbacks, StreamDecoder& decoder)
      : io_(io),
        config_(config),
        plan_(plan),
        ticket_(std::move(ticket)),
        callbacks_(callbacks),
        decoder_(decoder),
        dialer_(io, plan),
        websocket_(Dialer<Stream>::MakeStream(io, plan)),
        ping_timer_(io) {}

  void Start() {
    dialer_.Dial(websocket_.next_layer(), [this](std::string why) {
      if (!why.empty()) return End(std::move(why));
      Handshake();
    });
  }

  [[nodiscard]] bool connected() const { return connected_; }
  // The server closed because it wants a login, or another ticket.
  [[nodiscard]] bool login_refused() const { return login_refused_; }
  [[nodiscard]] const std::string& why_ended() const { return why_ended_; }

 private:
  using AsioError = boost::system::error_code;

  void Handshake() {
    namespace websocket = boost::beast::websocket;
    boost::beast::get_lowest_layer(websocket_).expires_never();  // the WebSocket has its own timers
    websocket::stream_base::timeout timeouts{};
    timeouts.handshake_timeout = plan_.timeout;
    timeouts.idle_timeout =
        std::chrono::milliseconds(static_cast<std::int64_t>(config_.silence_timeout_s * 1e3));
    timeouts.keep_alive_pings = true;
    websocket_.set_option(timeouts);
    websocket_.read_message_max(kMaxWatchPayloadBytes + 65'535);
    websocket_.async_handshake(plan_.url.host_header, "/watch", [this](AsioError error) {
      if (error) return End("the server refused to be watched (" + error.message() + ")");
      if (!ticket_.empty()) Send(ToJson(WatchTicket{ticket_}));
      if (config_.streams != WatchSubscribe{.color = true, .depth = true}) Send(ToJson(config_.streams));
      Ping();
      Read();
    });
  }

  void Ping() {
    Send(ToJson(WatchPing{static_cast<double>(MonotonicMicros())}));
    ping_timer_.expires_after(++pings_ < kQuickPings ? kQuickPingEvery : kPingEvery);
    ping_timer_.async_wait([this](AsioError cancelled) {
      if (!cancelled) Ping();
    });
  }

  void Send(std::string text) {
    sending_.push_back(std::move(text));
    if (sending_.size() == 1) Write();
  }
  void Write() {
    websocket_.text(true);
    websocket_.async_write(boost::asio::buffer(sending_.front()), [this](AsioError error, std::size_t) {
      if (error) return End("the connection broke (" + error.message() + ")");
      sending_.pop_front();
      if (!sending_.empty()) Write();
    });
  }

  void Read() {
    websocket_.async_read(buffer_, [this](AsioError error, std::size_t) {
      if (error == boost::beast::websocket::error::closed) return OnGoodbye();
      if (error) return End("the connection broke (" + error.message() + ")");
      if (!connected_) {
        connected_ = true;
        if (callbacks_.on_connected) callbacks_.on_connected();
      }
      const auto bytes = buffer_.cdata();
      if (websocket_.got_text()) {
        OnText({static_cast<const char*>(bytes.data()), bytes.size()});
      } else {
        OnBinary({static_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
      }
      buffer_.consume(buffer_.size());
      Read();
    });
  }

  void OnGoodbye() {
    login_refused_ = websocket_.reason().code == boost::beast::websocket::close_code::policy_error &&
                     std::string_view(websocket_.reason().reason.c_str()) == "login";
    if (!login_refused_) return End("the server said goodbye");
    End(ticket_.empty() ? "the server asks for a login" : "the server did not take the ticket");
  }

  void OnText(std::string_view text) {
    const Result<ServerMessage> message = ParseServerMessage(text);
    if (!message) {
      spdlog::warn("view server=\"{}\"", message.error().message);
    } else if (const auto* pong = std::get_if<WatchPong>(&*message)) {
      clock_.Answered(static_cast<std::int64_t>(std::clamp(pong->viewer_us, 0.0, 9e15)), MonotonicMicros(),
                      pong->server_us);
    } else if (const auto* stats = std::get_if<WatchStats>(&*message)) {
      if (callbacks_.on_stats) callbacks_.on_stats(*stats);
    } else if (const auto* hello = std::get_if<WatchHello>(&*message)) {
      if (callbacks_.on_hello) callbacks_.on_hello(*hello);
    }
  }

  void OnBinary(std::span<const std::uint8_t> message) {
    const auto mesh = ReadWatchMesh(message);
    if (mesh) {
      if (callbacks_.on_mesh) callbacks_.on_mesh(*mesh);
    } else if (mesh.error() == WatchRefusal::kStream) {  // of pictures
      OnPicture(message);
    } else {
      spdlog::warn("view mesh=refused reason={}", RefusalName(mesh.error()));
    }
  }

  void OnPicture(std::span<const std::uint8_t> message) {
    const auto picture = ReadWatchPicture(message);
    if (!picture) {
      spdlog::warn("view picture=refused reason={}", RefusalName(picture.error()));
      if (callbacks_.on_undecodable) callbacks_.on_undecodable(WatchStream::kColor);
      return;
    }
    const auto arrival = [this, &message] {
      const std::optional<std::int64_t> offset_us = clock_.offset_us();
      return PictureArrival{offset_us ? std::optional(MonotonicMicros() + *offset_us) : std::nullopt,
                            message.size()};
    };
    DecodeOutcome outcome = DecodeOutcome::kWaiting;
    if (picture->header.stream == WatchStream::kColor) {
      outcome = decoder_.DecodeColor(*picture, &color_);
      if (outcome == DecodeOutcome::kPicture && callbacks_.on_color) callbacks_.on_color(color_, arrival());
    } else {
      outcome = decoder_.DecodeDepth(*picture, &depth_);
      if (outcome == DecodeOutcome::kPicture && callbacks_.on_depth) callbacks_.on_depth(depth_, arrival());
    }
    if (outcome == DecodeOutcome::kUndecodable) {
      if (callbacks_.on_undecodable) callbacks_.on_undecodable(picture->header.stream);
      WishKeyFrame();
    }
  }

  void WishKeyFrame() {
    const std::int64_t now_us = MonotonicMicros();
    if (now_us - last_wish_us_ < kKeyFrameWishSpacingUs) return;
    last_wish_us_ = now_us;
    Send(ToJson(WatchKeyFrameWish{}));
  }

  void End(std::string why) {
    if (why_ended_.empty()) why_ended_ = std::move(why);
    io_.stop();  // what is pending is dropped with the session
  }

  boost::asio::io_context& io_;
  const WatchClientConfig& config_;
  const DialPlan& plan_;
  const std::string ticket_;
  const WatchCallbacks& callbacks_;
  StreamDecoder& decoder_;
  Dialer<Stream> dialer_;
  boost::beast::websocket::stream<Stream, false> websocket_;
  boost::asio::steady_timer ping_timer_;
  boost::beast::flat_buffer buffer_;
  std::deque<std::string> sending_;  // the front is on its way
  ServerClock clock_;
  ColorPicture color_;
  WatchedDepth depth_;
  static constexpr std::int64_t kKeyFrameWishSpacingUs = 500'000;
  static constexpr int kQuickPings = 5;
  static constexpr std::chrono::milliseconds kQuickPingEvery{200}, kPingEvery{1000};
  int pings_ = 0;
  std::int64_t last_wish_us_ = 0;
  bool connected_ = false, login_refused_ = false;
  std::string why_ended_;
};

}  // namespace mixstage
