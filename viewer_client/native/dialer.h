// SPDX-License-Identifier: Apache-2.0
//
// Opens a connection to a server: name, TCP and, for https, TLS. Private to viewer_client/native.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/host_name_verification.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/ssl.hpp>
#include <chrono>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>

#include "viewer_client/native/watch_url.h"

namespace mixstage {

using PlainStream = boost::beast::tcp_stream;
using TlsStream = boost::beast::ssl_stream<boost::beast::tcp_stream>;

// What all connections of a client share.
struct DialPlan {
  WatchUrl url;
  std::chrono::milliseconds timeout{};
  boost::asio::ssl::context* tls = nullptr;  // for url.tls; trusts whom the configuration trusts
};

// Lives in one io_context, which one thread runs; must outlive the dialling.
template <typename Stream>
class Dialer {
 public:
  using AsioError = boost::system::error_code;
  // Empty: the stream is open. Else why not.
  using Done = std::function<void(std::string why)>;

  Dialer(boost::asio::io_context& io, const DialPlan& plan) : plan_(plan), resolver_(io) {}

  static Stream MakeStream(boost::asio::io_context& io, const DialPlan& plan) {
    if constexpr (std::is_same_v<Stream, TlsStream>) {
      return TlsStream(io, *plan.tls);
    } else {
      return PlainStream(io);
    }
  }

  void Dial(Stream& stream, Done done) {
    done_ = std::move(done);
    Lowest(stream).expires_after(plan_.timeout);
    resolver_.async_resolve(plan_.url.host, plan_.url.port, [this, &stream](AsioError error, auto found) {
      if (error) return done_("the name " + plan_.url.host + " is not known");
      Lowest(stream).async_connect(found, [this, &stream](AsioError failed, const auto&) {
        if (failed)
          return done_("nobody listens at " + plan_.url.host_header + " (" + failed.message() + ")");
        AsioError ignored;
        Lowest(stream).socket().set_option(boost::asio::ip::tcp::no_delay(true), ignored);
        Secure(stream);
      });
    });
  }

 private:
  static PlainStream& Lowest(Stream& stream) { return boost::beast::get_lowest_layer(stream); }

  void Secure(Stream& stream) {
    if constexpr (std::is_same_v<Stream, TlsStream>) {
      AsioError not_an_address;
      boost::asio::ip::make_address(plan_.url.host, not_an_address);
      if (not_an_address) SSL_set_tlsext_host_name(stream.native_handle(), plan_.url.host.c_str());
      AsioError ignored;
      // Asked only where the context checks certificates at all.
      stream.set_verify_callback(boost::asio::ssl::host_name_verification(plan_.url.host), ignored);
      Lowest(stream).expires_after(plan_.timeout);
      stream.async_handshake(boost::asio::ssl::stream_base::client, [this, &stream](AsioError failed) {
        if (failed) return done_("no TLS with " + plan_.url.host_header + ": " + WhyNoTls(stream, failed));
        done_({});
      });
    } else {
      done_({});
    }
  }

  static std::string WhyNoTls(Stream& stream, AsioError failed) {
    const long verdict = SSL_get_verify_result(stream.native_handle());
    if (verdict == X509_V_OK) return failed.message();
    return std::string("its certificate is not trusted (") + X509_verify_cert_error_string(verdict) +
           "); give the authority's file (--ca)";
  }

  const DialPlan& plan_;
  boost::asio::ip::tcp::resolver resolver_;
  Done done_;
};

}  // namespace mixstage
