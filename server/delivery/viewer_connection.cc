// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/viewer_connection.h"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <optional>
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

ViewerConnection::ViewerConnection(SocketStream stream, std::string address, ConnectionSlot slot,
                                   AccessControl& access, ViewerHub& hub)
    : websocket_(std::move(stream)),
      address_(std::move(address)),
      slot_(std::move(slot)),
      access_(access),
      hub_(hub),
      // One byte more than allowed, so that "too long" can be seen.
      received_(kMaxViewerMessageBytes + 1),
      id_(hub.NextViewerId()),
      rate_(hub.config().messages_per_s, hub.config().message_burst),
      edit_rate_(hub.config().edits_per_s, hub.config().edit_burst) {}

void ViewerConnection::Start(const UpgradeRequest& request) {
  websocket_.next_layer().tcp().expires_never();  // the WebSocket has its own timers
  websocket::stream_base::timeout timeouts{};
  timeouts.handshake_timeout = std::chrono::seconds(5);
  timeouts.idle_timeout = websocket::stream_base::none();  // CheckProgress() sees to it
  timeouts.keep_alive_pings = false;
  websocket_.set_option(timeouts);
  websocket_.read_message_max(0);  // OnRead() counts, to close with the code of SPEC 4.2
  websocket_.auto_fragment(false);
  // Pings cost an answer each: they count like messages.
  websocket_.control_callback([this](websocket::frame_type, beast::string_view) {
    heard_us_ = MonotonicMicros();
    if (closing_ || rate_.Take(heard_us_)) return;
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
    self->opened_us_ = self->heard_us_ = MonotonicMicros();
    if (self->access_.login_needed()) {
      self->hub_.Await(self);
    } else {
      self->Admit({.role = WatchRole::kDirector});
    }
    self->Read();
  });
}

void ViewerConnection::Admit(ViewerIdentity identity) {
  identity_ = std::move(identity);
  admitted_ = true;
  slot_.NoStranger();
  hub_.Join(shared_from_this());
  SendText(std::make_shared<const std::string>(hub_.HelloText(identity_.role)));
  if (hub_.scene_text()) SendScene(hub_.scene_text());
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
  queue_.push_back({.picture = picture});
  Write();
}

void ViewerConnection::SendNewest(const std::shared_ptr<const WholeMessage>& message) {
  if (closing_ || finished_ || !subscribed(message->stream)) return;
  const auto waiting = std::find_if(
      queue_.begin() + (writing_ ? 1 : 0), queue_.end(),
      [&](const Outgoing& out) { return out.whole != nullptr && out.whole->stream == message->stream; });
  if (waiting != queue_.end()) {
    ++hub_.counters.dropped_mesh_slow;
    waiting->whole = message;
    return;
  }
  // Pictures first: these may not be what pushes them out.
  if (2 * queued_pictures_ > hub_.config().queued_pictures) {
    ++hub_.counters.dropped_mesh_slow;
    return;
  }
  queue_.push_back({.whole = message});
  Write();
}

void ViewerConnection::SendStandingMeshes() {
  if (closing_ || finished_ || !meshes_ || standing_queued_) return;
  StandingMeshes::Numbered next = hub_.standing_meshes().After(standing_sent_);
  if (next.mesh == nullptr) return;
  standing_queued_ = true;
  standing_sent_ = next.number;
  queue_.push_back({.whole = std::move(next.mesh)});
  Write();
}

void ViewerConnection::SendText(std::shared_ptr<const std::string> text) {
  if (closing_ || finished_) return;
  if (queue_.size() - static_cast<std::size_t>(queued_pictures_) >= kMaxQueuedTexts) {
    ++hub_.counters.closed_slow;
    return Abort();
  }
  queue_.push_back({.text = std::move(text)});
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
  const asio::const_buffer bytes = out.text != nullptr    ? asio::buffer(*out.text)
                                   : out.whole != nullptr ? asio::buffer(out.whole->bytes)
                                                          : asio::buffer(out.picture->message);
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
  if (const auto& whole = queue_.front().whole) {
    ++hub_.counters.meshes_sent;
    hub_.counters.mesh_bytes_sent += whole->bytes.size();
    if (IsStanding(whole->stream)) standing_queued_ = false;
  }
  queue_.pop_front();
  SendStandingMeshes();
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
  heard_us_ = MonotonicMicros();
  if (!websocket_.got_text()) return CloseForMessage("a binary message");
  if (received_.size() > kMaxViewerMessageBytes) return CloseForMessage("a message of more than 4,096 bytes");
  if (websocket_.is_message_done()) {
    const auto bytes = received_.cdata();
    const std::string_view text(static_cast<const char*>(bytes.data()), bytes.size());
    if (admitted_) {
      OnMessage(text);
    } else {
      LogIn(text);
    }
    received_.consume(received_.size());
    if (closing_) return;
  }
  Read();
}

void ViewerConnection::LogIn(std::string_view text) {
  const Result<ViewerMessage> message = ParseViewerMessage(text);
  const auto* ticket = message ? std::get_if<WatchTicket>(&*message) : nullptr;
  std::optional<ViewerIdentity> identity;
  if (ticket != nullptr) identity = access_.Redeem(ticket->ticket, MonotonicMicros());
  if (!identity) {
    access_.audit().AuditRefusedLogin(address_, "ticket");
    return CloseForLogin();
  }
  if (hub_.full()) {
    ++hub_.counters.refused_full;
    return Close(CloseCode::try_again_later, "full");
  }
  Admit(std::move(*identity));
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
  } else if (std::holds_alternative<WatchTicket>(*message)) {
    CloseForMessage("a ticket where none is asked for");
  } else {
    // Who asks for a key frame cannot use what comes before it.
    for (Stream& stream : streams_) stream.waiting = stream.may_ask = true;
    hub_.WishKeyFrame();
  }
}

void ViewerConnection::Edit(const WatchEdit& edit) {
  const auto audit = [&](const char* action) {
    // A drag is told by its last step.
    if (!edit.live) access_.audit().Audit(name(), role(), address_, action, ToJson(edit));
  };
  const auto refuse = [&](const char* reason) {
    audit("refused");
    SendText(std::make_shared<const std::string>(ToJson(WatchRefused{edit.id, reason})));
  };
  const std::shared_ptr<EditQueue>& edits = hub_.config().edits;
  if (!MayEdit()) return refuse("Only directors may edit the scene.");
  if (!edits) return refuse("This show has no scene to edit: start the server with --scene FILE.");
  // Only this thread puts edits in: there is room when it says so.
  if (edits->size() >= kMaxWaitingEdits) return refuse("Too many edits wait: try again.");
  audit("edit");
  edits->Push({edit, id_, name()});
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
  if (subscribe.mesh && !meshes_) standing_sent_ = 0;  // who comes back may have thrown away what it had
  meshes_ = subscribe.mesh;
  light_ = subscribe.light;
  SendStandingMeshes();
  hub_.CountSubscribers();
}

void ViewerConnection::CheckProgress(std::int64_t now_us) {
  const auto micros = [](double seconds) { return static_cast<std::int64_t>(seconds * 1e6); };
  const GatewayConfig& config = hub_.config();
  if (closing_) {
    if (now_us - close_started_us_ > kGoodbyeUs) Abort();
  } else if (!admitted_) {
    if (now_us - opened_us_ > micros(config.login_timeout_s)) CloseForLogin();
  } else if (writing_ && now_us - write_started_us_ > micros(config.stall_timeout_s)) {
    ++hub_.counters.closed_slow;
    spdlog::info("delivery viewer=closed reason=stalled");
    Abort();
  } else if (now_us - heard_us_ > micros(config.idle_timeout_s)) {
    ++hub_.counters.closed_idle;
    Close(CloseCode::policy_error, "idle");
  }
}

void ViewerConnection::CloseForLogin() {
  ++hub_.counters.closed_login;
  Close(CloseCode::policy_error, "login");
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
  websocket_.next_layer().tcp().close();  // what is pending ends with an error and calls Finish()
}

void ViewerConnection::Finish() {
  if (std::exchange(finished_, true)) return;
  Abort();
  // Not at once: the hub may be walking its list.
  asio::post(websocket_.get_executor(), [self = shared_from_this()] { self->hub_.Leave(self.get()); });
}

}  // namespace mixstage
