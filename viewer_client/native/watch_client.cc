// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/watch_client.h"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "viewer_client/native/server_clock.h"

namespace mixstage {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using AsioError = boost::system::error_code;

constexpr std::int64_t kKeyFrameWishSpacingUs = 500'000;
constexpr int kQuickPings = 5;
constexpr std::chrono::milliseconds kQuickPingEvery(200), kPingEvery(1000);

std::chrono::milliseconds Milliseconds(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1e3));
}

// One connection from resolve to its end. Lives in one io_context, which one thread runs.
class WatchSession {
 public:
  WatchSession(asio::io_context& io, const WatchClientConfig& config, const WatchUrl& url,
               const WatchCallbacks& callbacks, StreamDecoder& decoder)
      : io_(io),
        config_(config),
        url_(url),
        callbacks_(callbacks),
        decoder_(decoder),
        resolver_(io),
        websocket_(io),
        ping_timer_(io) {}

  void Start() {
    beast::get_lowest_layer(websocket_).expires_after(Milliseconds(config_.connect_timeout_s));
    resolver_.async_resolve(
        url_.host, url_.port, [this](AsioError error, const tcp::resolver::results_type& found) {
          if (error) return End("the name " + url_.host + " is not known");
          beast::get_lowest_layer(websocket_)
              .async_connect(found, [this](AsioError failed, const tcp::endpoint&) {
                if (failed)
                  return End("nobody listens at " + url_.host_header + " (" + failed.message() + ")");
                Handshake();
              });
        });
  }

  [[nodiscard]] bool connected() const { return connected_; }
  [[nodiscard]] const std::string& why_ended() const { return why_ended_; }

 private:
  void Handshake() {
    auto& stream = beast::get_lowest_layer(websocket_);
    AsioError ignored;
    stream.socket().set_option(tcp::no_delay(true), ignored);
    stream.expires_never();
    websocket::stream_base::timeout timeouts{};
    timeouts.handshake_timeout = Milliseconds(config_.connect_timeout_s);
    timeouts.idle_timeout = Milliseconds(config_.silence_timeout_s);
    timeouts.keep_alive_pings = true;
    websocket_.set_option(timeouts);
    websocket_.read_message_max(kMaxWatchPayloadBytes + 65'535);
    websocket_.async_handshake(url_.host_header, "/watch", [this](AsioError error) {
      if (error) return End("the server refused to be watched (" + error.message() + ")");
      connected_ = true;
      if (callbacks_.on_connected) callbacks_.on_connected();
      if (!config_.streams.color || !config_.streams.depth) Send(ToJson(config_.streams));
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
    websocket_.async_write(asio::buffer(sending_.front()), [this](AsioError error, std::size_t) {
      if (error) return End("the connection broke (" + error.message() + ")");
      sending_.pop_front();
      if (!sending_.empty()) Write();
    });
  }

  void Read() {
    websocket_.async_read(buffer_, [this](AsioError error, std::size_t) {
      if (error == websocket::error::closed) return End("the server said goodbye");
      if (error) return End("the connection broke (" + error.message() + ")");
      const auto bytes = buffer_.cdata();
      if (websocket_.got_text()) {
        OnText({static_cast<const char*>(bytes.data()), bytes.size()});
      } else {
        OnPicture({static_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
      }
      buffer_.consume(buffer_.size());
      Read();
    });
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
    } else if (callbacks_.on_hello) {
      callbacks_.on_hello(std::get<WatchHello>(*message));
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

  asio::io_context& io_;
  const WatchClientConfig& config_;
  const WatchUrl& url_;
  const WatchCallbacks& callbacks_;
  StreamDecoder& decoder_;
  tcp::resolver resolver_;
  websocket::stream<beast::tcp_stream, false> websocket_;
  asio::steady_timer ping_timer_;
  beast::flat_buffer buffer_;
  std::deque<std::string> sending_;  // the front is on its way
  ServerClock clock_;
  ColorPicture color_;
  WatchedDepth depth_;
  int pings_ = 0;
  std::int64_t last_wish_us_ = 0;
  bool connected_ = false;
  std::string why_ended_;
};

class WatchClientImpl final : public WatchClient {
 public:
  WatchClientImpl(WatchClientConfig config, WatchUrl url, WatchCallbacks callbacks, StreamDecoder decoder)
      : config_(std::move(config)),
        url_(std::move(url)),
        callbacks_(std::move(callbacks)),
        decoder_(std::move(decoder)) {}

  void Run(std::stop_token stop) override {
    double backoff_s = config_.shortest_backoff_s;
    while (!stop.stop_requested()) {
      if (WatchOnce(stop)) backoff_s = config_.shortest_backoff_s;
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, stop, Milliseconds(backoff_s), [] { return false; });
      backoff_s = std::min(2 * backoff_s, config_.longest_backoff_s);
    }
  }

 private:
  // Whether there was a connection at all.
  bool WatchOnce(const std::stop_token& stop) {
    decoder_.Reset();
    asio::io_context io(1);
    WatchSession session(io, config_, url_, callbacks_, decoder_);
    session.Start();
    {
      const std::stop_callback stop_io(stop, [&io] { io.stop(); });
      io.run();
    }
    if (!stop.stop_requested() && callbacks_.on_disconnected) callbacks_.on_disconnected(session.why_ended());
    return session.connected();
  }

  const WatchClientConfig config_;
  const WatchUrl url_;
  const WatchCallbacks callbacks_;
  StreamDecoder decoder_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
};

}  // namespace

Result<std::unique_ptr<WatchClient>> WatchClient::Create(WatchClientConfig config, WatchCallbacks callbacks) {
  const auto refuse = [](const char* what) {
    return Fail(ErrorCode::kInvalidConfig, std::string("viewer: ") + what);
  };
  if (!(config.connect_timeout_s >= 0.1 && config.connect_timeout_s <= 60)) {
    return refuse("connect_timeout_s must be within 0.1..60");
  }
  if (!(config.silence_timeout_s >= 1 && config.silence_timeout_s <= 600)) {
    return refuse("silence_timeout_s must be within 1..600");
  }
  if (!(config.shortest_backoff_s >= 0.01 && config.shortest_backoff_s <= config.longest_backoff_s &&
        config.longest_backoff_s <= 600)) {
    return refuse("backoff must be within 0.01..600 s, the shortest first");
  }
  Result<WatchUrl> url = ParseWatchUrl(config.url);
  if (!url) return tl::unexpected(url.error());
  Result<StreamDecoder> decoder = StreamDecoder::Create();
  if (!decoder) return tl::unexpected(decoder.error());
  return std::make_unique<WatchClientImpl>(std::move(config), std::move(*url), std::move(callbacks),
                                           std::move(*decoder));
}

}  // namespace mixstage
