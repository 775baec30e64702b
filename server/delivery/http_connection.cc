// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/http_connection.h"

#include <boost/beast/http/read.hpp>
#include <boost/beast/http/span_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <utility>

#include "proto/base/clock.h"
#include "server/delivery/viewer_connection.h"

namespace mixstage {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using AsioError = boost::system::error_code;

constexpr std::uint32_t kMaxHeaderBytes = 8192;
constexpr std::chrono::seconds kSendTimeout(30);
constexpr const char* kContentSecurityPolicy =
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' data:; connect-src 'self'; "
    "worker-src 'self'; style-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'";
constexpr const char* kTransportSecurity = "max-age=15552000";  // half a year

std::string_view View(beast::string_view text) { return {text.data(), text.size()}; }

void SetHeaders(http::fields& fields, std::string_view mime_type, std::string_view cache_control,
                bool secure_name) {
  const auto set = [&fields](beast::string_view name, std::string_view value) {
    fields.set(name, beast::string_view(value.data(), value.size()));
  };
  set("Content-Type", mime_type);
  set("Cache-Control", cache_control);
  set("Content-Security-Policy", kContentSecurityPolicy);
  set("X-Content-Type-Options", "nosniff");
  set("Referrer-Policy", "no-referrer");
  set("X-Frame-Options", "DENY");
  set("Cross-Origin-Opener-Policy", "same-origin");
  set("Cross-Origin-Resource-Policy", "same-origin");
  set("Permissions-Policy", "camera=(), microphone=(), geolocation=()");
  if (secure_name) set("Strict-Transport-Security", kTransportSecurity);
}

// An IPv4 address is one, whichever kind of socket it came in by.
boost::asio::ip::address PeerAddress(SocketStream& stream) {
  AsioError error;
  const auto address = stream.tcp().socket().remote_endpoint(error).address();
  if (!address.is_v6() || !address.to_v6().is_v4_mapped()) return address;
  return boost::asio::ip::make_address_v4(boost::asio::ip::v4_mapped, address.to_v6());
}

std::chrono::milliseconds RequestTimeout(const GatewayConfig& config) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(config.request_timeout_s * 1e3));
}

}  // namespace

HttpConnection::HttpConnection(SocketStream stream, ConnectionSlot slot, const HttpContent& content,
                               AccessControl& access, ViewerHub& hub)
    : stream_(std::move(stream)),
      address_(PeerAddress(stream_)),
      slot_(std::move(slot)),
      content_(content),
      access_(access),
      hub_(hub),
      buffer_(2 * kMaxHeaderBytes) {}

void HttpConnection::Start() {
  stream_.tcp().expires_after(RequestTimeout(hub_.config()));
  stream_.Handshake([self = shared_from_this()](AsioError error) {
    if (!error) self->Read();
  });
}

void HttpConnection::Read() {
  parser_.emplace();
  parser_->header_limit(kMaxHeaderBytes);
  parser_->body_limit(0);
  // The whole request must be there in this time; between requests it is how long a kept connection may idle.
  stream_.tcp().expires_after(RequestTimeout(hub_.config()));
  http::async_read(stream_, buffer_, *parser_,
                   [self = shared_from_this()](AsioError error, std::size_t) { self->OnRead(error); });
}

void HttpConnection::OnRead(AsioError error) {
  if (error) {
    // What is no HTTP gets one sentence where the connection still stands; the rest is silence.
    const bool malformed = error.category() == make_error_code(http::error::bad_method).category() &&
                           error != http::error::end_of_stream && error != http::error::partial_message;
    if (!malformed) return;
    Request request;
    request.version(11);
    request.keep_alive(false);
    return Send(request, {.status = http::status::bad_request,
                          .own_content = "This is no request that is served here.\n"});
  }
  const Request request = parser_->release();
  bool upgrade = false;
  Reply reply = Answer(request, &upgrade);
  if (upgrade) {
    std::make_shared<ViewerConnection>(std::move(stream_), address_.to_string(), std::move(slot_), access_,
                                       hub_)
        ->Start(request);
    return;
  }
  Send(request, std::move(reply));
}

HttpConnection::Reply HttpConnection::Answer(const Request& request, bool* upgrade) {
  const std::string_view host = View(request[http::field::host]);
  if (!access_.IsOwnHost(host)) {
    ++hub_.counters.refused_origin;
    return {.status = http::status::forbidden,
            .own_content =
                "This server has another name: localhost, or one of its certificate or configuration.\n"};
  }
  const std::string_view target = View(request.target());
  const std::string_view path = target.substr(0, target.find('?'));
  const bool login = path == "/login" && request.method() == http::verb::post;
  if (!login && request.method() != http::verb::get && request.method() != http::verb::head) {
    return {.status = http::status::method_not_allowed, .own_content = "Only GET and HEAD are served.\n"};
  }
  if (!login && path != "/watch") return Get(request, path);

  // A program (mixstage-view) sends no Origin; a browser always does, and then it must be our own page.
  const auto origin = request.find(http::field::origin);
  if (origin != request.end() && !access_.MayConnect(View(origin->value()), host)) {
    ++hub_.counters.refused_origin;
    return {.status = http::status::forbidden, .own_content = "A page of another origin may not watch.\n"};
  }
  if (login) return LogIn(request);
  if (!beast::websocket::is_upgrade(request) || buffer_.size() != 0) {
    return {.status = http::status::upgrade_required, .own_content = "/watch is a WebSocket.\n"};
  }
  if (hub_.full()) {
    ++hub_.counters.refused_full;
    return {.status = http::status::service_unavailable,
            .own_content = "As many viewers as may watch are there.\n"};
  }
  *upgrade = true;
  return {};
}

HttpConnection::Reply HttpConnection::LogIn(const Request& request) {
  using Outcome = AccessControl::LoginOutcome;
  if (!access_.login_needed()) {
    return {.status = http::status::not_found, .own_content = "This server asks for no login.\n"};
  }
  const AccessControl::Login login =
      access_.LogIn(View(request[http::field::authorization]), address_, MonotonicMicros());
  ++(login.outcome == Outcome::kAdmitted ? hub_.counters.logins : hub_.counters.refused_login);
  switch (login.outcome) {
    case Outcome::kAdmitted:
      break;
    case Outcome::kRefused:
      return {.status = http::status::unauthorized,
              .own_content = "That is no token of this server.\n",
              .further = http::field::www_authenticate,
              .further_value = "Bearer"};
    case Outcome::kTooMany:
      return {.status = http::status::too_many_requests,
              .own_content = "Too many attempts; wait a moment.\n",
              .further = http::field::retry_after,
              .further_value = "2"};
    case Outcome::kFull:
      return {.status = http::status::service_unavailable,
              .own_content = "Too many logins at once; wait a moment.\n",
              .further = http::field::retry_after,
              .further_value = "30"};
  }
  // A token's name has no character that JSON would escape.
  return {.mime_type = "application/json",
          .own_content = R"({"ticket":")" + login.ticket + R"(","role":")" +
                         std::string(RoleName(login.identity.role)) + R"(","name":")" + login.identity.name +
                         "\"}\n"};
}

bool HttpConnection::MayReadMetrics(const Request& request) {
  // What a proxy on this machine passes on comes from elsewhere.
  const bool forwarded =
      request.count("X-Forwarded-For") + request.count("Forwarded") + request.count("X-Real-IP") > 0;
  if (address_.is_loopback() && !forwarded) return true;
  return access_.IsKnownBearer(View(request[http::field::authorization]), address_, MonotonicMicros());
}

HttpConnection::Reply HttpConnection::Get(const Request& request, std::string_view path) {
  if (path == "/healthz") {
    const std::string& state = hub_.state();
    const char* status = state.empty()                            ? "starting"
                         : state == "live" || state == "learning" ? "ok"
                                                                  : "degraded";
    return {.mime_type = "application/json",
            .own_content = R"({"status":")" + std::string(status) + R"(","state":")" + state +
                           R"(","login":)" + (access_.login_needed() ? "true" : "false") + "}\n"};
  }
  if (path == "/metrics") {
    if (!MayReadMetrics(request)) {
      return {.status = http::status::unauthorized,
              .own_content = "From elsewhere /metrics takes a bearer token.\n",
              .further = http::field::www_authenticate,
              .further_value = "Bearer"};
    }
    return {.mime_type = "text/plain; version=0.0.4; charset=utf-8",
            .own_content = content_.metrics ? content_.metrics() : std::string()};
  }
  if (const PageFile* file = content_.pages.Find(path)) {
    return {.mime_type = file->mime_type, .cache_control = file->cache_control, .content = &file->content};
  }
  if (path == "/" && content_.pages.empty()) {
    return {.status = http::status::not_found,
            .own_content = "This server was started without the page; mixstage-view can watch it.\n"};
  }
  return {.status = http::status::not_found, .own_content = "There is no such page.\n"};
}

void HttpConnection::Send(const Request& request, Reply reply) {
  // Alive until the last byte is out; span_body points into it.
  struct Sending {
    Reply reply;
    http::response<http::span_body<const char>> response;
    std::optional<http::response_serializer<http::span_body<const char>>> serializer;
  };
  const auto sending = std::make_shared<Sending>();
  sending->reply = std::move(reply);
  const Reply& r = sending->reply;
  const std::string& content = r.content != nullptr ? *r.content : r.own_content;
  auto& response = sending->response;
  response.version(request.version());
  response.result(r.status);
  // Of localhost it would be said for every other server on it.
  const bool secure_name = stream_.secure() && !IsLoopbackHost(View(request[http::field::host]));
  SetHeaders(response, r.mime_type, r.cache_control, secure_name);
  if (r.further != http::field::unknown) {
    response.set(r.further, beast::string_view(r.further_value.data(), r.further_value.size()));
  }
  response.keep_alive(request.keep_alive());
  response.body() = beast::span<const char>(content.data(), content.size());
  response.prepare_payload();
  stream_.tcp().expires_after(kSendTimeout);
  const auto done = [self = shared_from_this(), sending](AsioError error, std::size_t) {
    if (error) return;
    if (sending->response.need_eof() || !sending->response.keep_alive()) {
      self->stream_.tcp().expires_after(RequestTimeout(self->hub_.config()));
      self->stream_.ShutdownSend([self](AsioError) {});
      return;
    }
    self->Read();
  };
  sending->serializer.emplace(response);
  if (request.method() == http::verb::head) {
    http::async_write_header(stream_, *sending->serializer, done);
  } else {
    http::async_write(stream_, *sending->serializer, done);
  }
}

}  // namespace mixstage
