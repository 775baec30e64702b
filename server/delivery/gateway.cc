// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/gateway.h"

#include <pthread.h>

#include <array>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "server/delivery/access_control.h"
#include "server/delivery/http_connection.h"
#include "server/delivery/listen_address.h"
#include "server/delivery/viewer_connection.h"

namespace mixstage {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using AsioError = boost::system::error_code;

constexpr std::size_t kMaxInbox = 64;  // pictures that wait for `serve`; a second of both streams
constexpr std::chrono::milliseconds kTick(250);
constexpr std::chrono::milliseconds kAcceptPause(100);
constexpr std::int64_t kGoodbyeUs = 300'000;  // for the viewers' half of the closing handshake

Status Validate(const GatewayConfig& config) {
  const auto within = [](auto value, auto low, auto high, const char* name) -> Status {
    if (value >= low && value <= high) return {};
    return Fail(ErrorCode::kInvalidConfig, std::string("gateway: ") + name + " is out of range");
  };
  const std::array checks = {
      within(config.max_connections, 1, 10'000, "max_connections"),
      within(config.max_viewers, 1, config.max_connections, "max_viewers"),
      within(config.max_strangers, 1, 10'000, "max_strangers"),
      within(config.queued_pictures, 2, 1000, "queued_pictures"),
      within(config.queued_bytes, 1 << 16, 1 << 28, "queued_bytes"),
      within(config.send_buffer_bytes, 1 << 12, 1 << 24, "send_buffer_bytes"),
      within(config.messages_per_s, 0.1, 10'000.0, "messages_per_s"),
      within(config.message_burst, 1.0, 10'000.0, "message_burst"),
      within(config.edits_per_s, 0.1, 10'000.0, "edits_per_s"),
      within(config.edit_burst, 1.0, 10'000.0, "edit_burst"),
      within(config.request_timeout_s, 0.05, 600.0, "request_timeout_s"),
      within(config.stall_timeout_s, 0.05, 600.0, "stall_timeout_s"),
      within(config.login_timeout_s, 0.05, 600.0, "login_timeout_s"),
      within(config.idle_timeout_s, 0.05, 3600.0, "idle_timeout_s"),
  };
  for (const Status& check : checks) {
    if (!check) return check;
  }
  return {};
}

}  // namespace

class Gateway::Impl {
 public:
  Impl(GatewayConfig config, std::function<std::string()> metrics)
      : config_(std::move(config)),
        access_(config_),
        hub_(config_),
        acceptor_(io_),
        tick_(io_),
        accept_pause_(io_) {
    content_.metrics = std::move(metrics);
  }
  ~Impl() {
    Stop();
    hub_.CloseNow();
  }

  Status Start() {
    MIX_CHECK(!thread_.joinable());
    if (const Status valid = Validate(config_); !valid) return valid;
    const Result<ListenAddress> address = ParseListenAddress(config_.listen);
    if (!address) return tl::unexpected(address.error());
    if (const Status opened = access_.Open(*address); !opened) return opened;
    if (!config_.page_folder.empty()) {
      Result<PageFiles> pages = PageFiles::Load(config_.page_folder);
      if (!pages) return tl::unexpected(pages.error());
      content_.pages = std::move(*pages);
    }
    if (const Status opened = Open(*address); !opened) return opened;
    url_ = access_.Url(*address, port_);
    Accept();
    Tick();
    thread_ = std::thread([this] { Serve(); });
    spdlog::info("delivery listen={}:{} tls={} login={} page={}", address->ip, port_,
                 access_.tls() != nullptr, access_.login_needed(),
                 content_.pages.empty() ? "none" : "loaded");
    return {};
  }

  void Stop() {
    if (!thread_.joinable()) return;
    asio::post(io_, [this] { Goodbye(); });
    thread_.join();
  }

  void Publish(std::shared_ptr<const WatchPicture> picture) {
    MIX_CHECK(picture != nullptr);
    {
      const std::lock_guard lock(mutex_);
      if (inbox_.pictures.size() >= kMaxInbox) {
        hub_.counters.dropped_publish += inbox_.pictures.size();
        inbox_.pictures.clear();
        inbox_.gap = true;
      }
      inbox_.pictures.push_back(std::move(picture));
    }
    Wake();
  }
  void PublishWhole(std::shared_ptr<const WholeMessage> message) {
    MIX_CHECK(message != nullptr);
    {
      const std::lock_guard lock(mutex_);
      if (IsStanding(message->stream)) {
        inbox_.standing_meshes[{message->stream, message->id}] = message;
      } else {
        inbox_.newest[message->stream] = message;
      }
    }
    Wake();
  }
  void RemoveMesh(WatchStream stream, std::uint32_t id) {
    {
      const std::lock_guard lock(mutex_);
      inbox_.standing_meshes[{stream, id}] = nullptr;
    }
    Wake();
  }
  void PublishStats(std::string stats) {
    {
      const std::lock_guard lock(mutex_);
      inbox_.stats = std::move(stats);
    }
    Wake();
  }
  void PublishScene(std::string scene) {
    {
      const std::lock_guard lock(mutex_);
      inbox_.scene = std::move(scene);
    }
    Wake();
  }
  void SendTo(std::uint64_t viewer, std::string json) {
    {
      const std::lock_guard lock(mutex_);
      if (inbox_.answers.size() < kMaxWaitingEdits) inbox_.answers.emplace_back(viewer, std::move(json));
    }
    Wake();
  }
  void SetHello(WatchHello hello) {
    {
      const std::lock_guard lock(mutex_);
      inbox_.hello = std::move(hello);
    }
    Wake();
  }

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string url() const { return url_; }
  [[nodiscard]] ViewerHub& hub() { return hub_; }

 private:
  // What other threads left for `serve`.
  struct Inbox {
    std::vector<std::shared_ptr<const WatchPicture>> pictures;
    std::map<WatchStream, std::shared_ptr<const WholeMessage>> newest;
    // The last word on each; null: it is to go.
    std::map<std::pair<WatchStream, std::uint32_t>, std::shared_ptr<const WholeMessage>> standing_meshes;
    std::optional<std::string> stats;
    std::optional<WatchHello> hello;
    std::optional<std::string> scene;
    std::vector<std::pair<std::uint64_t, std::string>> answers;  // to one viewer each
    bool gap = false;
  };

  Status Open(const ListenAddress& address) {
    const tcp::endpoint endpoint(asio::ip::make_address(address.ip), address.port);
    AsioError error;
    acceptor_.open(endpoint.protocol(), error);
    if (!error) acceptor_.set_option(tcp::acceptor::reuse_address(true), error);
    if (!error) acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    if (!error) port_ = acceptor_.local_endpoint(error).port();
    if (!error) return {};
    AsioError ignored;
    acceptor_.close(ignored);
    const std::string where = "listen address " + config_.listen + ": ";
    if (error == asio::error::address_in_use) {
      return Fail(ErrorCode::kUnavailable,
                  where + "the port is in use; stop the other program or choose another port with --listen");
    }
    return Fail(ErrorCode::kUnavailable, where + error.message());
  }

  void Serve() {
    pthread_setname_np(pthread_self(), "serve");
    while (true) {
      try {
        io_.run();
        return;
      } catch (const std::exception& e) {  // a handler's (out of memory); its connection dies with it
        spdlog::error("delivery exception=\"{}\"", e.what());
      }
    }
  }

  void Wake() {
    if (woken_.exchange(true)) return;
    asio::post(io_, [this] {
      woken_ = false;
      Inbox inbox;
      {
        const std::lock_guard lock(mutex_);
        inbox = std::exchange(inbox_, {});
      }
      if (inbox.gap) hub_.AfterGap();
      if (inbox.hello) hub_.SetHello(std::move(*inbox.hello));
      for (const auto& picture : inbox.pictures) hub_.Publish(picture);
      for (const auto& [key, mesh] : inbox.standing_meshes) hub_.ReplaceMesh(key.first, key.second, mesh);
      for (const auto& [stream, message] : inbox.newest) hub_.PublishNewest(message);
      if (inbox.scene) hub_.PublishScene(std::move(*inbox.scene));
      for (auto& [viewer, json] : inbox.answers) hub_.SendTo(viewer, std::move(json));
      if (inbox.stats) hub_.PublishStats(std::move(*inbox.stats));
    });
  }

  void Accept() {
    acceptor_.async_accept([this](AsioError error, tcp::socket socket) {
      if (!acceptor_.is_open()) return;
      if (error) {  // no more file descriptors, or the other side is gone already
        accept_pause_.expires_after(kAcceptPause);
        accept_pause_.async_wait([this](AsioError cancelled) {
          if (!cancelled) Accept();
        });
        return;
      }
      Welcome(std::move(socket));
      Accept();
    });
  }

  void Welcome(tcp::socket socket) {
    AsioError ignored;
    const std::string network = NetworkOf(socket.remote_endpoint(ignored).address());
    if (hub_.counters.connections >= static_cast<std::uint64_t>(config_.max_connections) ||
        strangers_.Of(network) >= config_.max_strangers) {
      ++hub_.counters.refused_full;
      return;  // closes it
    }
    socket.set_option(tcp::no_delay(true), ignored);
    socket.set_option(asio::socket_base::send_buffer_size(config_.send_buffer_bytes), ignored);
    SocketStream stream = access_.tls() != nullptr ? SocketStream(std::move(socket), *access_.tls())
                                                   : SocketStream(std::move(socket));
    std::make_shared<HttpConnection>(std::move(stream),
                                     ConnectionSlot(hub_.counters.connections, strangers_, network), content_,
                                     access_, hub_)
        ->Start();
  }

  void Tick() {
    tick_.expires_after(kTick);
    tick_.async_wait([this](AsioError cancelled) {
      if (cancelled) return;
      const std::int64_t now_us = MonotonicMicros();
      if (access_.Refresh(now_us)) {
        hub_.CloseUnless([this](const ViewerIdentity& identity) { return access_.MayStay(identity); });
      }
      hub_.CheckProgress(now_us);
      Tick();
    });
  }

  void Goodbye() {
    AsioError ignored;
    acceptor_.close(ignored);
    accept_pause_.cancel();
    hub_.CloseAll();
    StopWhenAlone(MonotonicMicros() + kGoodbyeUs);
  }
  void StopWhenAlone(std::int64_t at_latest_us) {
    if (hub_.counters.viewers == 0 || MonotonicMicros() >= at_latest_us) return io_.stop();
    tick_.expires_after(std::chrono::milliseconds(5));  // cancels the tick
    tick_.async_wait([this, at_latest_us](AsioError) { StopWhenAlone(at_latest_us); });
  }

  const GatewayConfig config_;
  AccessControl access_;
  HttpContent content_;
  // These outlive io_, whose pending handlers hold connections that count themselves here.
  StrangerCounts strangers_;
  ViewerHub hub_;
  asio::io_context io_{1};
  tcp::acceptor acceptor_;
  asio::steady_timer tick_, accept_pause_;
  std::uint16_t port_ = 0;
  std::string url_;
  std::mutex mutex_;
  Inbox inbox_;  // guarded by mutex_
  std::atomic<bool> woken_{false};
  std::thread thread_;
};

Gateway::Gateway(GatewayConfig config, std::function<std::string()> metrics)
    : impl_(std::make_unique<Impl>(std::move(config), std::move(metrics))) {}
Gateway::~Gateway() = default;

Status Gateway::Check(const GatewayConfig& config) {
  if (const Status valid = Validate(config); !valid) return valid;
  const Result<ListenAddress> address = ParseListenAddress(config.listen);
  if (!address) return tl::unexpected(address.error());
  return AccessControl(config).Open(*address);
}

Status Gateway::Start() { return impl_->Start(); }
void Gateway::Stop() { impl_->Stop(); }
std::uint16_t Gateway::port() const { return impl_->port(); }
std::string Gateway::url() const { return impl_->url(); }
void Gateway::Publish(std::shared_ptr<const WatchPicture> picture) { impl_->Publish(std::move(picture)); }
void Gateway::PublishWhole(std::shared_ptr<const WholeMessage> message) {
  impl_->PublishWhole(std::move(message));
}
void Gateway::RemoveMesh(WatchStream stream, std::uint32_t id) { impl_->RemoveMesh(stream, id); }
void Gateway::PublishStats(std::string stats_json) { impl_->PublishStats(std::move(stats_json)); }
void Gateway::PublishScene(std::string scene_json) { impl_->PublishScene(std::move(scene_json)); }
void Gateway::SendTo(std::uint64_t viewer, std::string json) { impl_->SendTo(viewer, std::move(json)); }
void Gateway::SetHello(WatchHello hello) { impl_->SetHello(std::move(hello)); }
bool Gateway::TakeKeyFrameRequest() { return impl_->hub().TakeKeyFrameRequest(MonotonicMicros()); }
bool Gateway::WantsStream(WatchStream stream) const { return impl_->hub().WantsStream(stream); }

GatewayCounters Gateway::counters() const {
  const AtomicCounters& c = impl_->hub().counters;
  return {.connections = c.connections,
          .viewers = c.viewers,
          .pictures_sent = c.pictures_sent,
          .bytes_sent = c.bytes_sent,
          .meshes_sent = c.meshes_sent,
          .mesh_bytes_sent = c.mesh_bytes_sent,
          .dropped_viewer_slow = c.dropped_viewer_slow,
          .dropped_mesh_slow = c.dropped_mesh_slow,
          .dropped_publish = c.dropped_publish,
          .closed_slow = c.closed_slow,
          .closed_message = c.closed_message,
          .closed_rate = c.closed_rate,
          .closed_login = c.closed_login,
          .closed_idle = c.closed_idle,
          .logins = c.logins,
          .refused_login = c.refused_login,
          .refused_origin = c.refused_origin,
          .refused_full = c.refused_full};
}

}  // namespace mixstage
