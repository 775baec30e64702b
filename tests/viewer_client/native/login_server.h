// SPDX-License-Identifier: Apache-2.0
//
// A server that asks for a login (SPEC.md 4.4), of a few lines: one token, tickets that serve once, then a
// hello. One thread for each connection.
#pragma once

#include <openssl/ec.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "proto/watch/text_message.h"

namespace mixstage {

struct TestCertificate {
  std::string certificate_pem, key_pem;
};

// Signed by itself, for one name.
inline TestCertificate MakeTestCertificate(const std::string& host) {
  EVP_PKEY* key = EVP_EC_gen("P-256");
  X509* x = X509_new();
  ASN1_INTEGER_set(X509_get_serialNumber(x), 1);
  X509_set_version(x, 2);
  X509_gmtime_adj(X509_getm_notBefore(x), -3600);
  X509_gmtime_adj(X509_getm_notAfter(x), 3600);
  X509_set_pubkey(x, key);
  const auto* name = reinterpret_cast<const unsigned char*>(host.c_str());
  X509_NAME_add_entry_by_txt(X509_get_subject_name(x), "CN", MBSTRING_ASC, name, -1, -1, 0);
  X509_set_issuer_name(x, X509_get_subject_name(x));
  X509_EXTENSION* names =
      X509V3_EXT_conf_nid(nullptr, nullptr, NID_subject_alt_name, ("DNS:" + host).c_str());
  X509_add_ext(x, names, -1);
  X509_sign(x, key, EVP_sha256());
  const auto pem = [](auto write) {
    BIO* bio = BIO_new(BIO_s_mem());
    write(bio);
    char* data = nullptr;
    const long size = BIO_get_mem_data(bio, &data);
    std::string text(data, static_cast<std::size_t>(size));
    BIO_free(bio);
    return text;
  };
  TestCertificate made;
  made.certificate_pem = pem([&](BIO* bio) { PEM_write_bio_X509(bio, x); });
  made.key_pem =
      pem([&](BIO* bio) { PEM_write_bio_PrivateKey(bio, key, nullptr, nullptr, 0, nullptr, nullptr); });
  X509_EXTENSION_free(names);
  X509_free(x);
  EVP_PKEY_free(key);
  return made;
}

class LoginServer {
 public:
  explicit LoginServer(std::string token, const std::optional<TestCertificate>& certificate = {})
      : token_(std::move(token)), tls_(boost::asio::ssl::context::tls_server), secure_(certificate) {
    if (certificate) {
      tls_.use_certificate_chain(boost::asio::buffer(certificate->certificate_pem));
      tls_.use_private_key(boost::asio::buffer(certificate->key_pem), boost::asio::ssl::context::pem);
    }
    thread_ = std::thread([this] { Accept(); });
  }
  ~LoginServer() {
    stopping_ = true;
    boost::system::error_code ignored;
    tcp::socket wake(io_);  // accept() has no other end
    wake.connect({boost::asio::ip::make_address("127.0.0.1"), port()}, ignored);
    thread_.join();
    CloseViewers();
    for (std::thread& thread : connections_) thread.join();
  }

  [[nodiscard]] std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
  // As if the server's network broke: viewers come back with a new ticket.
  void CloseViewers() {
    const std::lock_guard lock(mutex_);
    for (tcp::socket* socket : viewers_) {
      boost::system::error_code ignored;
      socket->shutdown(tcp::socket::shutdown_both, ignored);
    }
  }
  void Revoke() {
    const std::lock_guard lock(mutex_);
    token_.clear();
  }
  void ForgetTickets() { forgetful_ = true; }

  std::atomic<int> logins{0}, refused{0}, watched{0};

 private:
  using tcp = boost::asio::ip::tcp;

  void Accept() {
    while (true) {
      tcp::socket socket(io_);
      acceptor_.accept(socket);
      if (stopping_) return;
      connections_.emplace_back([this, s = std::move(socket)]() mutable {
        try {
          if (secure_) {
            boost::asio::ssl::stream<tcp::socket> stream(std::move(s), tls_);
            stream.handshake(boost::asio::ssl::stream_base::server);
            Serve(stream, stream.next_layer());
          } else {
            Serve(s, s);
          }
        } catch (const boost::system::system_error&) {
          // the other side has gone: what it saw is the test's business
        }
      });
    }
  }

  template <typename Stream>
  void Serve(Stream& stream, tcp::socket& socket) {
    namespace http = boost::beast::http;
    boost::beast::flat_buffer buffer;
    http::request<http::string_body> request;
    http::read(stream, buffer, request);
    if (request.target() == "/watch") return Watch(stream, socket, request);
    http::response<http::string_body> answer;
    if (request.target() != "/login" || request.method() != http::verb::post) {
      answer.result(http::status::not_found);
    } else if (const std::string ticket = Ticket(std::string(request[http::field::authorization]));
               ticket.empty()) {
      answer.result(http::status::unauthorized);
      ++refused;
    } else {
      answer.body() = R"({"ticket": ")" + ticket + R"(", "role": "viewer", "name": "anna"})";
      ++logins;
    }
    answer.prepare_payload();
    http::write(stream, answer);
  }

  std::string Ticket(const std::string& authorization) {
    const std::lock_guard lock(mutex_);
    if (token_.empty() || authorization != "Bearer " + token_) return {};
    std::string ticket = std::to_string(++last_ticket_);
    ticket.insert(0, 43 - ticket.size(), 't');
    tickets_.insert(ticket);
    return ticket;
  }

  template <typename Stream>
  void Watch(Stream& stream, tcp::socket& socket,
             const boost::beast::http::request<boost::beast::http::string_body>& request) {
    namespace websocket = boost::beast::websocket;
    websocket::stream<Stream&> viewer(stream);
    viewer.accept(request);
    boost::beast::flat_buffer buffer;
    viewer.read(buffer);
    bool valid = false;
    {
      const std::lock_guard lock(mutex_);
      const std::string first = boost::beast::buffers_to_string(buffer.data());
      for (const std::string& ticket : tickets_) {
        if (first != ToJson(WatchTicket{ticket})) continue;
        valid = !forgetful_.exchange(false);
        tickets_.erase(ticket);
        break;
      }
    }
    if (!valid) {
      viewer.close({websocket::close_code::policy_error, "login"});
      return;
    }
    ++watched;
    viewer.text(true);
    viewer.write(boost::asio::buffer(ToJson(WatchHello{.name = "test"})));
    {
      const std::lock_guard lock(mutex_);
      viewers_.insert(&socket);
    }
    boost::system::error_code error;
    while (!error) {
      buffer.clear();
      viewer.read(buffer, error);
    }
    const std::lock_guard lock(mutex_);
    viewers_.erase(&socket);
  }

  std::string token_;
  boost::asio::ssl::context tls_;
  const bool secure_;
  boost::asio::io_context io_;
  tcp::acceptor acceptor_{io_, {boost::asio::ip::make_address("127.0.0.1"), 0}};
  std::atomic<bool> stopping_{false}, forgetful_{false};
  std::mutex mutex_;  // guards token_, tickets_, viewers_
  std::set<std::string> tickets_;
  std::set<tcp::socket*> viewers_;
  int last_ticket_ = 0;
  std::vector<std::thread> connections_;
  std::thread thread_;
};

}  // namespace mixstage
