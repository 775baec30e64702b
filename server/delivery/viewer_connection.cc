// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/viewer_connection.h"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"

namespace mixstage {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using AsioError = boost::system::error_code;

constexpr std::size_t kMaxQueuedTexts = 64;
constexpr std::int64_t kGoodbyeUs = 2'000'000;  // for the other side's half of the closing handshake

}  // namespace

ViewerConnection::ViewerConnection(beast::tcp_stream stream, ConnectionSlot slot, ViewerHub& hub)
    : websocket_(std::move(stream)),
      slot_(std::move(slot)),
      hub_(hub),
      // One byte more than allowed, so that "too long" can be seen.
      received_(kMaxViewerMessageBytes + 1),
      id_(hub.NextViewerId()),
      rate_(hub.config().messages_per_s, hub.config().message_burst),
      edit_rate_(hub.config().edits_per_s, hub.config().edit_burst) {}

void ViewerConnection::Start(const UpgradeRequest& request) {
  beast::get_lowest_layer(websocket_).expires_never();  // the WebSocket has its own timers
  websocket::stream_base::timeout timeouts{};
  timeouts.handshake_timeout = std::chrono::seconds(5);
  timeouts.idle_timeout = std::chrono::seconds(60);
  timeouts.keep_alive_pings = true;
  websocket_.set_option(timeouts);
  websocket_.read_message_max(0);  // OnRead() counts, to close with the code of SPEC 4.2
  websocket_.auto_fragment(false);
  // Pings cost an answer each: they count like messages.
  websocket_.control_callback([this](websocket::frame_type, beast::string_view) {
    if (closing_ || rate_.Take(MonotonicMicros())) return;
    ++hub_.counters.closed_rate;
    asio::post(websocket_.get_executor(),
               [self = shared_from_this()] { self->Close(CloseCode::policy_error, "rate"); });
  });
  websocket_.async_accept(request, [self = shared_from_this()](AsioError error) {
    if (error) return;
    if (self->hub_.full()) {  // others came while this one shook hands
      ++self->hub_.counters.refused_full;
      return self->Abort();
    }
    self->hub_.Join(self);
    self->SendText(std::make_shared<const std::string>(self->hub_.HelloText()));
    if (self->hub_.scene_text()) self->SendScene(self->hub_.scene_text());
    self->Read();
  });
}

bool ViewerConnection::wants_key_frame() const {
  return std::ranges::any_of(streams_,
                             [](const Stream& s) { return s.subscribed && s.waiting && s.may_ask; });
}

void ViewerConnection::SendPicture(const std::shared_ptr<const WatchPicture>& picture) {
  Stream& stream = streams_[StreamIndex(picture->stream)];
  if (closing_ || finished_ || !stream.subscribed) return;
  const GatewayConfig& config = hub_.config();
  // A single picture larger than the whole bound still goes out when nothing else waits.
  if (queued_pictures_ >= config.queued_pictures ||
      (queued_pictures_ > 0 &&
       queued_bytes_ + picture->message.size() > static_cast<std::size_t>(config.queued_bytes))) {
    // Too slow. It is not given a key frame of its own: that would cost every other viewer.
    ClearPictures();
    for (Stream& other : streams_) {
      other.waiting = true;
      other.may_ask = false;
    }
    // With a picture still on its way a key frame may not fit either; the next one will.
    if (queued_pictures_ > 0) {
      ++hub_.counters.dropped_viewer_slow;
      return;
    }
  }
  if (stream.waiting && !picture->key_frame) {
    if (stream.may_ask) {
      hub_.WishKeyFrame();
    } else {
      ++hub_.counters.dropped_viewer_slow;
    }
    return;
  }
  stream.waiting = false;
  stream.may_ask = true;
  ++queued_pictures_;
  queued_bytes_ += picture->message.size();
  queue_.push_back({.picture = picture, .text = nullptr});
  Write();
}

void ViewerConnection::SendText(std::shared_ptr<const std::string> text) {
  if (closing_ || finished_) return;
  if (queue_.size() - static_cast<std::size_t>(queued_pictures_) >= kMaxQueuedTexts) {
    ++hub_.counters.closed_slow;
    return Abort();
  }
  queue_.push_back({.picture = nullptr, .text = std::move(text)});
  Write();
}

void ViewerConnection::SendScene(const std::shared_ptr<const std::string>& text) {
  const auto first = queue_.begin() + (writing_ ? 1 : 0);
  const auto waiting = std::find_if(first, queue_.end(), [](const Outgoing& out) { return out.scene; });
  if (waiting != queue_.end()) {
    waiting->text = text;
    return;
  }
  const std::size_t before = queue_.size();
  SendText(text);
  if (queue_.size() > before) queue_.back().scene = true;
}

void ViewerConnection::WaitForKeyFrame() {
  for (Stream& stream : streams_) stream.waiting = true;
}

void ViewerConnection::ClearPictures() {
  const auto first = queue_.begin() + (writing_ ? 1 : 0);
  const auto kept = std::remove_if(first, queue_.end(), [this](const Outgoing& out) {
    if (out.picture == nullptr) return false;
    --queued_pictures_;
    queued_bytes_ -= out.picture->message.size();
    ++hub_.counters.dropped_viewer_slow;
    return true;
  });
  queue_.erase(kept, queue_.end());
}

void ViewerConnection::Write() {
  if (writing_ || closing_ || finished_ || queue_.empty()) return;
  writing_ = true;
  write_started_us_ = MonotonicMicros();
  const Outgoing& out = queue_.front();
  websocket_.text(out.text != nullptr);
  const asio::const_buffer bytes =
      out.text != nullptr ? asio::buffer(*out.text) : asio::buffer(out.picture->message);
  websocket_.async_write(
      bytes, [self = shared_from_this()](AsioError error, std::size_t) { self->OnWritten(error); });
}

void ViewerConnection::OnWritten(AsioError error) {
  writing_ = false;
  if (error) return Finish();
  if (const auto& picture = queue_.front().picture) {
    --queued_pictures_;
    queued_bytes_ -= picture->message.size();
    ++hub_.counters.pictures_sent;
    hub_.counters.bytes_sent += picture->message.size();
  }
  queue_.pop_front();
  Write();
}

void ViewerConnection::Read() {
  websocket_.async_read_some(
      received_, kMaxViewerMessageBytes + 1 - received_.size(),
      [self = shared_from_this()](AsioError error, std::size_t) { self->OnRead(error); });
}

void ViewerConnection::OnRead(AsioError error) {
  if (error) return Finish();
  if (closing_) return;  // the closing handshake reads for itself
  if (!websocket_.got_text()) return CloseForMessage("a binary message");
  if (received_.size() > kMaxViewerMessageBytes) return CloseForMessage("a message of more than 4,096 bytes");
  if (websocket_.is_message_done()) {
    const auto bytes = received_.cdata();
    OnMessage({static_cast<const char*>(bytes.data()), bytes.size()});
    received_.consume(received_.size());
    if (closing_) return;
  }
  Read();
}

void ViewerConnection::OnMessage(std::string_view text) {
  const Result<ViewerMessage> message = ParseViewerMessage(text);
  const bool is_edit = message && std::holds_alternative<WatchEdit>(*message);
  if (!(is_edit ? edit_rate_ : rate_).Take(MonotonicMicros())) {
    ++hub_.counters.closed_rate;
    return Close(CloseCode::policy_error, "rate");
  }
  if (!message) return CloseForMessage(message.error().message);
  if (const auto* ping = std::get_if<WatchPing>(&*message)) {
    SendText(std::make_shared<const std::string>(ToJson(WatchPong{ping->viewer_us, MonotonicMicros()})));
  } else if (const auto* subscribe = std::get_if<WatchSubscribe>(&*message)) {
    Subscribe(*subscribe);
  } else if (const auto* edit = std::get_if<WatchEdit>(&*message)) {
    Edit(*edit);
  } else {
    // Who asks for a key frame cannot use what comes before it.
    for (Stream& stream : streams_) stream.waiting = stream.may_ask = true;
    hub_.WishKeyFrame();
  }
}

void ViewerConnection::Edit(const WatchEdit& edit) {
  const auto refuse = [&](const char* reason) {
    SendText(std::make_shared<const std::string>(ToJson(WatchRefused{edit.id, reason})));
  };
  const std::shared_ptr<EditQueue>& edits = hub_.config().edits;
  if (!IsDirector()) return refuse("Only directors may edit the scene.");
  if (!edits) return refuse("This show has no scene to edit: start the server with --scene FILE.");
  // Only this thread puts edits in: there is room when it says so.
  if (edits->size() >= kMaxWaitingEdits) return refuse("Too many edits wait: try again.");
  edits->Push({edit, id_, Name()});
}

void ViewerConnection::Subscribe(const WatchSubscribe& subscribe) {
  const auto set = [this](WatchStream which, bool wanted) {
    Stream& stream = streams_[StreamIndex(which)];
    if (wanted && !stream.subscribed) {
      stream.waiting = stream.may_ask = true;
      hub_.WishKeyFrame();
    }
    stream.subscribed = wanted;
  };
  set(WatchStream::kColor, subscribe.color);
  set(WatchStream::kDepth, subscribe.depth);
  hub_.CountSubscribers();
}

void ViewerConnection::CheckProgress(std::int64_t now_us) {
  const auto stall_us = static_cast<std::int64_t>(hub_.config().stall_timeout_s * 1e6);
  if (closing_) {
    if (now_us - close_started_us_ > kGoodbyeUs) Abort();
  } else if (writing_ && now_us - write_started_us_ > stall_us) {
    ++hub_.counters.closed_slow;
    spdlog::info("delivery viewer=closed reason=stalled");
    Abort();
  }
}

void ViewerConnection::CloseForMessage(const std::string& reason) {
  ++hub_.counters.closed_message;
  spdlog::info("delivery viewer=closed reason=message what=\"{}\"", reason);
  Close(CloseCode::policy_error, "message");
}

void ViewerConnection::Close(CloseCode code, const char* reason) {
  if (closing_ || finished_) return;
  closing_ = true;
  close_started_us_ = MonotonicMicros();
  ClearPictures();
  websocket_.async_close({code, reason}, [self = shared_from_this()](AsioError) { self->Finish(); });
}

void ViewerConnection::Abort() {
  beast::get_lowest_layer(websocket_).close();  // what is pending ends with an error and calls Finish()
}

void ViewerConnection::Finish() {
  if (std::exchange(finished_, true)) return;
  Abort();
  // Not at once: the hub may be walking its list.
  asio::post(websocket_.get_executor(), [self = shared_from_this()] { self->hub_.Leave(self.get()); });
}

}  // namespace mixstage
