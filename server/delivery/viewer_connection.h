// SPDX-License-Identifier: Apache-2.0
//
// One viewer's WebSocket. Private to the gateway; everything on its `serve` thread.
#pragma once

#include <array>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>

#include "server/delivery/connection_slot.h"
#include "server/delivery/token_bucket.h"
#include "server/delivery/viewer_hub.h"

namespace mixstage {

class ViewerConnection : public std::enable_shared_from_this<ViewerConnection> {
 public:
  using CloseCode = boost::beast::websocket::close_code;
  using UpgradeRequest = boost::beast::http::request<boost::beast::http::empty_body>;

  ViewerConnection(boost::beast::tcp_stream stream, ConnectionSlot slot, ViewerHub& hub);

  // Answers the upgrade, joins the hub, says hello.
  void Start(const UpgradeRequest& request);

  void SendPicture(const std::shared_ptr<const WatchPicture>& picture);
  void SendText(std::shared_ptr<const std::string> text);
  // A `scene` message; takes the place of one that still waits.
  void SendScene(const std::shared_ptr<const std::string>& text);
  // Skips predicted pictures from here on: what they were predicted from is missing.
  void WaitForKeyFrame();
  // Cuts off who has taken nothing for too long, or does not answer a goodbye.
  void CheckProgress(std::int64_t now_us);
  // With the closing handshake. Nothing is sent after it.
  void Close(CloseCode code, const char* reason);

  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] bool subscribed(WatchStream stream) const { return streams_[StreamIndex(stream)].subscribed; }
  // Waits for a key frame that may be asked for on its behalf (a slow viewer waits for the next one by
  // itself).
  [[nodiscard]] bool wants_key_frame() const;

 private:
  struct Outgoing {  // one of the two
    std::shared_ptr<const WatchPicture> picture;
    std::shared_ptr<const std::string> text;
    bool scene = false;  // the text is a scene
  };
  struct Stream {
    bool subscribed = true;
    bool waiting = true;  // for a key frame
    bool may_ask = true;  // for one to be made
  };

  void Read();
  void OnRead(boost::system::error_code error);
  void OnMessage(std::string_view text);
  void Subscribe(const WatchSubscribe& subscribe);
  void Edit(const WatchEdit& edit);
  // Whoever reaches a server without login is a director (SPEC 4.4).
  [[nodiscard]] static bool IsDirector() { return true; }
  [[nodiscard]] static std::string Name() { return "director"; }
  void Write();
  void OnWritten(boost::system::error_code error);
  void ClearPictures();
  void CloseForMessage(const std::string& reason);
  void Abort();   // closes the socket now
  void Finish();  // leaves the hub, once

  boost::beast::websocket::stream<boost::beast::tcp_stream, false> websocket_;
  ConnectionSlot slot_;
  ViewerHub& hub_;
  boost::beast::flat_buffer received_;
  std::uint64_t id_;
  TokenBucket rate_, edit_rate_;
  std::array<Stream, kWatchStreams> streams_;
  std::deque<Outgoing> queue_;  // while writing_, the front is on its way
  int queued_pictures_ = 0;
  std::size_t queued_bytes_ = 0;  // of pictures
  bool writing_ = false;
  bool closing_ = false;
  bool finished_ = false;
  std::int64_t write_started_us_ = 0;
  std::int64_t close_started_us_ = 0;
};

}  // namespace mixstage
