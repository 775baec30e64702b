// SPDX-License-Identifier: Apache-2.0
//
// POST /login (SPEC.md 4.4): a token for a ticket. Private to viewer_client/native.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <string>
#include <utility>

#include "proto/watch/login_message.h"
#include "viewer_client/native/dialer.h"

namespace mixstage {

enum class LoginOutcome {
  kTicket = 1,
  kNotNeeded,  // the server lets everyone in
  kRefused,    // it has no such token
  kFailed,     // nobody there, too many attempts, ...: worth another try
};
struct LoginAnswer {
  LoginOutcome outcome = LoginOutcome::kFailed;
  std::string ticket{}, why{"the connection broke"};
};

// One request on a connection of its own, in one io_context: run that, then take the answer.
template <typename Stream>
class LoginRequest {
 public:
  LoginRequest(boost::asio::io_context& io, const DialPlan& plan, const std::string& token)
      : plan_(plan), dialer_(io, plan), stream_(Dialer<Stream>::MakeStream(io, plan)), token_(token) {}

  void Start() {
    dialer_.Dial(stream_, [this](std::string why) {
      if (!why.empty()) return Fail(std::move(why));
      Ask();
    });
  }
  [[nodiscard]] const LoginAnswer& answer() const { return answer_; }

 private:
  using AsioError = boost::system::error_code;

  void Ask() {
    namespace http = boost::beast::http;
    request_.method(http::verb::post);
    request_.target("/login");
    request_.version(11);
    request_.set(http::field::host, plan_.url.host_header);
    request_.set(http::field::authorization, "Bearer " + token_);
    request_.set(http::field::content_length, "0");
    request_.set(http::field::connection, "close");
    boost::beast::get_lowest_layer(stream_).expires_after(plan_.timeout);
    http::async_write(stream_, request_, [this](AsioError error, std::size_t) {
      if (error) return Fail("the login broke off (" + error.message() + ")");
      parser_.body_limit(kMaxLoginAnswerBytes);
      http::async_read(stream_, buffer_, parser_, [this](AsioError failed, std::size_t) {
        if (failed) return Fail("the login broke off (" + failed.message() + ")");
        OnAnswer();
      });
    });
  }

  void OnAnswer() {
    const unsigned status = parser_.get().result_int();
    if (status == 404 || status == 405) {  // 405: of servers that only serve pages
      answer_ = {LoginOutcome::kNotNeeded, {}, {}};
    } else if (status == 401) {
      answer_ = {LoginOutcome::kRefused, {}, "the server refused the token"};
    } else if (status != 200) {
      Fail("the server answered the login with " + std::to_string(status));
    } else if (auto login = ParseLoginAnswer(parser_.get().body()); !login) {
      Fail(login.error().message);
    } else {
      answer_ = {LoginOutcome::kTicket, std::move(login->ticket), {}};
    }
  }

  void Fail(std::string why) { answer_ = {LoginOutcome::kFailed, {}, std::move(why)}; }

  const DialPlan& plan_;
  Dialer<Stream> dialer_;
  Stream stream_;
  const std::string& token_;
  boost::beast::http::request<boost::beast::http::empty_body> request_;
  boost::beast::http::response_parser<boost::beast::http::string_body> parser_;
  boost::beast::flat_buffer buffer_{16'384};
  LoginAnswer answer_;
};

}  // namespace mixstage
