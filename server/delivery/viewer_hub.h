// SPDX-License-Identifier: Apache-2.0
//
// The viewers that are connected, what they are all told, and what they ask for. Private to the gateway.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/delivery/gateway.h"
#include "server/delivery/viewer_identity.h"

namespace mixstage {

class ViewerConnection;

// Counters are written on `serve`, read anywhere.
struct AtomicCounters {
  std::atomic<std::uint64_t> connections{0}, viewers{0}, pictures_sent{0}, bytes_sent{0}, meshes_sent{0},
      mesh_bytes_sent{0}, dropped_viewer_slow{0}, dropped_mesh_slow{0}, dropped_publish{0}, closed_slow{0},
      closed_message{0}, closed_rate{0}, closed_login{0}, closed_idle{0}, logins{0}, refused_login{0},
      refused_origin{0}, refused_full{0};
};

class ViewerHub {
 public:
  explicit ViewerHub(const GatewayConfig& config) : config_(config) {}

  // ---- Only on `serve` ----
  [[nodiscard]] bool full() const { return viewers_.size() >= static_cast<std::size_t>(config_.max_viewers); }
  // One who has not brought a ticket yet: told nothing, but watched over.
  void Await(std::shared_ptr<ViewerConnection> stranger);
  void Join(std::shared_ptr<ViewerConnection> viewer);
  void Leave(const ViewerConnection* viewer);
  void Publish(const std::shared_ptr<const WatchPicture>& picture);
  // Of the actor's mesh or the light map.
  void PublishNewest(const std::shared_ptr<const WholeMessage>& message);
  // mesh: null = it stands no longer.
  void ReplaceMesh(WatchStream stream, std::uint32_t id, std::shared_ptr<const WholeMessage> mesh);
  [[nodiscard]] const StandingMeshes& standing_meshes() const { return standing_meshes_; }
  void PublishStats(std::string stats_json);
  void SetHello(WatchHello hello);
  void PublishScene(std::string scene_json);
  void SendTo(std::uint64_t viewer, std::string json);
  // Pictures were lost before they came here: nobody can decode on before the next key frame.
  void AfterGap();
  // Closes who stalls or is silent.
  void CheckProgress(std::int64_t now_us);
  // Closes those whose token was revoked.
  void CloseUnless(const std::function<bool(const ViewerIdentity&)>& may_stay);
  void CloseAll();
  // Forgets all viewers, when `serve` has ended.
  void CloseNow();
  // A viewer's subscriptions changed.
  void CountSubscribers();
  void WishKeyFrame() { key_frame_wished_.store(true, std::memory_order_relaxed); }
  [[nodiscard]] std::string HelloText(WatchRole role) const;
  // The newest `scene` message; null while there is none.
  [[nodiscard]] const std::shared_ptr<const std::string>& scene_text() const { return scene_text_; }
  // A number for a new viewer, > 0.
  [[nodiscard]] std::uint64_t NextViewerId() { return ++last_viewer_id_; }
  [[nodiscard]] const std::string& state() const { return state_; }
  [[nodiscard]] const GatewayConfig& config() const { return config_; }

  // ---- Any thread ----
  [[nodiscard]] bool TakeKeyFrameRequest(std::int64_t now_us);
  [[nodiscard]] bool WantsStream(WatchStream stream) const {
    return subscribers_[static_cast<std::size_t>(stream)].load(std::memory_order_relaxed) > 0;
  }
  AtomicCounters counters;

 private:
  const GatewayConfig& config_;
  std::vector<std::shared_ptr<ViewerConnection>> viewers_;
  std::vector<std::shared_ptr<ViewerConnection>> strangers_;
  WatchHello hello_;
  std::shared_ptr<const std::string> scene_text_;
  std::uint64_t last_viewer_id_ = 0;
  std::string state_;
  std::array<std::atomic<int>, static_cast<std::size_t>(WatchStream::kLightMap) + 1>
      subscribers_{};  // by stream
  StandingMeshes standing_meshes_;
  std::atomic<bool> key_frame_wished_{false};
  std::atomic<std::int64_t> key_frame_given_us_{0};
};

}  // namespace mixstage
