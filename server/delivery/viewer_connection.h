// SPDX-License-Identifier: Apache-2.0
//
// One viewer's WebSocket. Private to the gateway; everything on its `serve` thread.
#pragma once

#include <array>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>

#include "server/delivery/access_control.h"
#include "server/delivery/connection_slot.h"
#include "server/delivery/socket_stream.h"
#include "server/delivery/token_bucket.h"
#include "server/delivery/viewer_hub.h"
#include "server/delivery/viewer_identity.h"

namespace mixstage {

class ViewerConnection : public std::enable_shared_from_this<ViewerConnection> {
 public:
  using CloseCode = boost::beast::websocket::close_code;
  using UpgradeRequest = boost::beast::http::request<boost::beast::http::empty_body>;

  // address: of the other end, for the audit log.
  ViewerConnection(SocketStream stream, std::string address, ConnectionSlot slot, AccessControl& access,
                   ViewerHub& hub);

  // Answers the upgrade; then, at once or when a good ticket came, joins the hub and says hello.
  void Start(const UpgradeRequest& request);

  void SendPicture(const std::shared_ptr<const WatchPicture>& picture);
  // The newest waits for its turn in place of an older one; a viewer that is behind misses it.
  void SendNewest(const std::shared_ptr<const WholeMessage>& mesh);
  // Those that it has not got yet, one after another.
  void SendStandingMeshes();
  void SendText(std::shared_ptr<const std::string> text);
  // A `scene` message; takes the place of one that still waits.
  void SendScene(const std::shared_ptr<const std::string>& text);
  // Skips predicted pictures from here on: what they were predicted from is missing.
  void WaitForKeyFrame();
  // Closes who brings no ticket, says nothing or takes nothing for too long, or does not answer a goodbye.
  void CheckProgress(std::int64_t now_us);
  // With the closing handshake. Nothing is sent after it.
  void Close(CloseCode code, const char* reason);
  // Because the login is missing, wrong or ended.
  void CloseForLogin();

  // Who this is; before the login nobody, who gets nothing and may do nothing.
  [[nodiscard]] const ViewerIdentity& identity() const { return identity_; }
  [[nodiscard]] const std::string& name() const { return identity_.name; }
  [[nodiscard]] WatchRole role() const { return identity_.role; }
  [[nodiscard]] const std::string& address() const { return address_; }
  // The one place that decides who may change the scene.
  [[nodiscard]] bool MayEdit() const { return admitted_ && identity_.role == WatchRole::kDirector; }

  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] bool subscribed(WatchStream stream) const {
    if (StreamIndex(stream) < kWatchStreams) return streams_[StreamIndex(stream)].subscribed;
    return stream == WatchStream::kLightMap ? light_ : meshes_;
  }
  // Waits for a key frame that may be asked for on its behalf (a slow viewer waits for the next one by
  // itself).
  [[nodiscard]] bool wants_key_frame() const;

 private:
  struct Outgoing {  // one of the three
    std::shared_ptr<const WatchPicture> picture{};
    std::shared_ptr<const std::string> text{};
    std::shared_ptr<const WholeMessage> whole{};
    bool scene = false;  // the text is a scene
  };
  struct Stream {
    bool subscribed = true;
    bool waiting = true;  // for a key frame
    bool may_ask = true;  // for one to be made
  };

  void Admit(ViewerIdentity identity);  // joins the hub, says hello
  void Read();
  void OnRead(boost::system::error_code error);
  void LogIn(std::string_view text);  // the first message, where a login is asked for
  void OnMessage(std::string_view text);
  void Subscribe(const WatchSubscribe& subscribe);
  void Edit(const WatchEdit& edit);
  void Write();
  void OnWritten(boost::system::error_code error);
  void ClearPictures();
  void CloseForMessage(const std::string& reason);
  void Abort();   // closes the socket now
  void Finish();  // leaves the hub, once

  boost::beast::websocket::stream<SocketStream, false> websocket_;
  const std::string address_;
  ConnectionSlot slot_;
  AccessControl& access_;
  ViewerHub& hub_;
  boost::beast::flat_buffer received_;
  std::uint64_t id_;
  TokenBucket rate_, edit_rate_;
  ViewerIdentity identity_;
  bool admitted_ = false;
  std::array<Stream, kWatchStreams> streams_;
  std::deque<Outgoing> queue_;  // while writing_, the front is on its way
  int queued_pictures_ = 0;
  std::size_t queued_bytes_ = 0;         // of pictures
  bool meshes_ = false, light_ = false;  // subscribed
  // In the queue at most one mesh of the actor and one light map beside what is being written, and one
  // standing mesh.
  bool standing_queued_ = false;
  std::uint64_t standing_sent_ = 0;  // its number in the hub's list
  bool writing_ = false;
  bool closing_ = false;
  bool finished_ = false;
  std::int64_t opened_us_ = 0;
  std::int64_t heard_us_ = 0;  // when the last frame of any kind came
  std::int64_t write_started_us_ = 0;
  std::int64_t close_started_us_ = 0;
};

}  // namespace mixstage
