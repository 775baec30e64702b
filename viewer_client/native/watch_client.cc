// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/watch_client.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

#include "viewer_client/native/dialer.h"
#include "viewer_client/native/login_request.h"
#include "viewer_client/native/watch_session.h"

namespace mixstage {
namespace {

namespace asio = boost::asio;
using AsioError = boost::system::error_code;

std::chrono::milliseconds Milliseconds(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1e3));
}

// Whom a context believes.
Status Trust(const WatchClientConfig& config, asio::ssl::context& tls) {
  AsioError error;
  tls.set_options(
      asio::ssl::context::default_workarounds | asio::ssl::context::no_tlsv1 | asio::ssl::context::no_tlsv1_1,
      error);
  tls.set_verify_mode(config.tls_check == TlsCheck::kNone ? asio::ssl::verify_none : asio::ssl::verify_peer,
                      error);
  if (config.ca_file.empty()) {
    tls.set_default_verify_paths(error);
    return {};  // without them no certificate is trusted, which the connection says
  }
  tls.load_verify_file(config.ca_file, error);
  if (error) {
    return Fail(ErrorCode::kInvalidConfig,
                config.ca_file + ": holds no certificates in PEM that can be read (" + error.message() + ")");
  }
  return {};
}

class WatchClientImpl final : public WatchClient {
 public:
  WatchClientImpl(WatchClientConfig config, WatchUrl url, asio::ssl::context tls, WatchCallbacks callbacks,
                  StreamDecoder decoder)
      : config_(std::move(config)),
        tls_(std::move(tls)),
        plan_{std::move(url), Milliseconds(config_.connect_timeout_s), &tls_},
        callbacks_(std::move(callbacks)),
        decoder_(std::move(decoder)) {}

  WatchEnd Run(std::stop_token stop) override {
    double backoff_s = config_.shortest_backoff_s;
    while (!stop.stop_requested()) {
      const Attempt attempt = plan_.url.tls ? WatchOnce<TlsStream>(stop) : WatchOnce<PlainStream>(stop);
      if (stop.stop_requested()) break;
      if (callbacks_.on_disconnected) callbacks_.on_disconnected(attempt.why);
      if (attempt.login_refused) return WatchEnd::kLoginRefused;
      if (attempt.connected) backoff_s = config_.shortest_backoff_s;
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, stop, Milliseconds(backoff_s), [] { return false; });
      backoff_s = std::min(2 * backoff_s, config_.longest_backoff_s);
    }
    return WatchEnd::kStopped;
  }

 private:
  struct Attempt {
    bool connected = false;      // was let in, for however short
    bool login_refused = false;  // for good
    std::string why{};           // it ended
  };

  static void RunUntil(asio::io_context& io, const std::stop_token& stop) {
    const std::stop_callback stop_io(stop, [&io] { io.stop(); });
    io.run();
  }

  template <typename Stream>
  Attempt WatchOnce(const std::stop_token& stop) {
    std::string ticket;
    if (!config_.token.empty()) {
      asio::io_context io(1);
      LoginRequest<Stream> login(io, plan_, config_.token);
      login.Start();
      RunUntil(io, stop);
      const LoginAnswer& answer = login.answer();
      if (answer.outcome == LoginOutcome::kRefused) return {.login_refused = true, .why = answer.why};
      if (answer.outcome == LoginOutcome::kFailed) return {.why = answer.why};
      ticket = answer.ticket;
    }
    decoder_.Reset();
    asio::io_context io(1);
    WatchSession<Stream> session(io, config_, plan_, ticket, callbacks_, decoder_);
    session.Start();
    RunUntil(io, stop);
    // A ticket may have been forgotten by a server that restarted meanwhile: the next attempt has a new one.
    return {.connected = session.connected(),
            .login_refused = session.login_refused() && config_.token.empty(),
            .why = session.why_ended()};
  }

  const WatchClientConfig config_;
  asio::ssl::context tls_;
  const DialPlan plan_;
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
  if (!config.token.empty()) {
    if (!IsTokenText(config.token)) return refuse("the token is not 43 characters of base64url");
    if (!url->tls && !IsThisMachine(*url))
      return refuse("a token goes to another machine only over TLS: use https://");
  }
  asio::ssl::context tls(asio::ssl::context::tls_client);
  if (const Status trusted = Trust(config, tls); !trusted) return tl::unexpected(trusted.error());
  Result<StreamDecoder> decoder = StreamDecoder::Create();
  if (!decoder) return tl::unexpected(decoder.error());
  return std::make_unique<WatchClientImpl>(std::move(config), std::move(*url), std::move(tls),
                                           std::move(callbacks), std::move(*decoder));
}

}  // namespace mixstage
