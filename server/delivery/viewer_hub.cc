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

void ViewerHub::Await(std::shared_ptr<ViewerConnection> stranger) {
  strangers_.push_back(std::move(stranger));
}

void ViewerHub::Join(std::shared_ptr<ViewerConnection> viewer) {
  std::erase(strangers_, viewer);
  viewers_.push_back(std::move(viewer));
  counters.viewers = viewers_.size();
  CountSubscribers();
  WishKeyFrame();
}

void ViewerHub::Leave(const ViewerConnection* viewer) {
  for (auto* list : {&viewers_, &strangers_})
    std::erase_if(*list, [viewer](const auto& other) { return other.get() == viewer; });
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

void ViewerHub::PublishNewest(const std::shared_ptr<const WholeMessage>& message) {
  for (const auto& viewer : viewers_) viewer->SendNewest(message);
}

void ViewerHub::ReplaceMesh(WatchStream stream, std::uint32_t id, std::shared_ptr<const WholeMessage> mesh) {
  if (mesh == nullptr) return standing_meshes_.Remove(stream, id);
  standing_meshes_.Put(std::move(mesh));
  for (const auto& viewer : viewers_) viewer->SendStandingMeshes();
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
  for (const auto& viewer : viewers_)
    viewer->SendText(std::make_shared<const std::string>(HelloText(viewer->role())));
}

void ViewerHub::PublishScene(std::string scene_json) {
  scene_text_ = std::make_shared<const std::string>(std::move(scene_json));
  for (const auto& viewer : viewers_) viewer->SendScene(scene_text_);
}

void ViewerHub::SendTo(std::uint64_t id, std::string json) {
  const auto found = std::ranges::find_if(viewers_, [id](const auto& viewer) { return viewer->id() == id; });
  if (found != viewers_.end()) (*found)->SendText(std::make_shared<const std::string>(std::move(json)));
}

std::string ViewerHub::HelloText(WatchRole role) const {
  WatchHello hello = hello_;
  hello.role = role;
  hello.server_us = MonotonicMicros();
  return ToJson(hello);
}

void ViewerHub::AfterGap() {
  for (const auto& viewer : viewers_) viewer->WaitForKeyFrame();
  if (!viewers_.empty()) WishKeyFrame();
}

void ViewerHub::CheckProgress(std::int64_t now_us) {
  for (const auto& viewer : viewers_) viewer->CheckProgress(now_us);
  for (const auto& stranger : strangers_) stranger->CheckProgress(now_us);
}

void ViewerHub::CloseUnless(const std::function<bool(const ViewerIdentity&)>& may_stay) {
  for (const auto& viewer : viewers_) {
    if (!may_stay(viewer->identity())) viewer->CloseForLogin();
  }
}

void ViewerHub::CloseAll() {
  for (const auto* list : {&viewers_, &strangers_})
    for (const auto& viewer : *list)
      viewer->Close(ViewerConnection::CloseCode::going_away, "the server stops");
}

void ViewerHub::CloseNow() {
  viewers_.clear();
  strangers_.clear();
}

void ViewerHub::CountSubscribers() {
  for (std::size_t stream = 1; stream < subscribers_.size(); ++stream) {
    const auto count = std::ranges::count_if(
        viewers_, [&](const auto& viewer) { return viewer->subscribed(static_cast<WatchStream>(stream)); });
    subscribers_[stream].store(static_cast<int>(count), std::memory_order_relaxed);
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
