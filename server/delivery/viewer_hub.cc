// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/viewer_hub.h"

#include <algorithm>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "server/delivery/viewer_connection.h"

namespace mixstage {
namespace {

constexpr std::int64_t kKeyFrameSpacingUs = 500'000;  // SPEC 4.2: at most twice a second for all together

}  // namespace

void ViewerHub::Join(std::shared_ptr<ViewerConnection> viewer) {
  viewers_.push_back(std::move(viewer));
  counters.viewers = viewers_.size();
  CountSubscribers();
  WishKeyFrame();
}

void ViewerHub::Leave(const ViewerConnection* viewer) {
  std::erase_if(viewers_, [viewer](const auto& other) { return other.get() == viewer; });
  counters.viewers = viewers_.size();
  CountSubscribers();
}

void ViewerHub::Publish(const std::shared_ptr<const WatchPicture>& picture) {
  // Sending can close a connection, which leaves the list on a later turn of the loop: the list stands still
  // here.
  for (const auto& viewer : viewers_) viewer->SendPicture(picture);
  // A key frame may have served the wishes that came while it was being encoded.
  if (picture->key_frame &&
      std::ranges::none_of(viewers_, [](const auto& viewer) { return viewer->wants_key_frame(); })) {
    key_frame_wished_.store(false, std::memory_order_relaxed);
  }
}

void ViewerHub::PublishStats(std::string stats_json) {
  if (const Result<ServerMessage> stats = ParseServerMessage(stats_json)) {
    if (const auto* known = std::get_if<WatchStats>(&*stats)) state_ = known->state;
  } else {
    spdlog::warn("delivery stats=\"{}\"", stats.error().message);
  }
  const auto text = std::make_shared<const std::string>(std::move(stats_json));
  for (const auto& viewer : viewers_) viewer->SendText(text);
}

void ViewerHub::SetHello(WatchHello hello) {
  hello_ = std::move(hello);
  const auto text = std::make_shared<const std::string>(HelloText());
  for (const auto& viewer : viewers_) viewer->SendText(text);
}

void ViewerHub::PublishScene(std::string scene_json) {
  scene_text_ = std::make_shared<const std::string>(std::move(scene_json));
  for (const auto& viewer : viewers_) viewer->SendScene(scene_text_);
}

void ViewerHub::SendTo(std::uint64_t id, std::string json) {
  const auto found = std::ranges::find_if(viewers_, [id](const auto& viewer) { return viewer->id() == id; });
  if (found != viewers_.end()) (*found)->SendText(std::make_shared<const std::string>(std::move(json)));
}

std::string ViewerHub::HelloText() const {
  WatchHello hello = hello_;
  hello.server_us = MonotonicMicros();
  return ToJson(hello);
}

void ViewerHub::AfterGap() {
  for (const auto& viewer : viewers_) viewer->WaitForKeyFrame();
  if (!viewers_.empty()) WishKeyFrame();
}

void ViewerHub::CheckProgress(std::int64_t now_us) {
  for (const auto& viewer : viewers_) viewer->CheckProgress(now_us);
}

void ViewerHub::CloseAll() {
  for (const auto& viewer : viewers_)
    viewer->Close(ViewerConnection::CloseCode::going_away, "the server stops");
}

void ViewerHub::CloseNow() { viewers_.clear(); }

void ViewerHub::CountSubscribers() {
  for (const WatchStream stream : {WatchStream::kColor, WatchStream::kDepth}) {
    const auto count =
        std::ranges::count_if(viewers_, [&](const auto& viewer) { return viewer->subscribed(stream); });
    subscribers_[StreamIndex(stream)].store(static_cast<int>(count), std::memory_order_relaxed);
  }
}

bool ViewerHub::TakeKeyFrameRequest(std::int64_t now_us) {
  if (!key_frame_wished_.load(std::memory_order_relaxed)) return false;
  std::int64_t given_us = key_frame_given_us_.load(std::memory_order_relaxed);
  if (given_us != 0 && now_us - given_us < kKeyFrameSpacingUs) return false;
  // Of two threads that ask at once one gets it.
  if (!key_frame_given_us_.compare_exchange_strong(given_us, now_us)) return false;
  key_frame_wished_.store(false, std::memory_order_relaxed);
  return true;
}

}  // namespace mixstage
