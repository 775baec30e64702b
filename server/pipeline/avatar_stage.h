// SPDX-License-Identifier: Apache-2.0
//
// The stage that brings the actor to another place (piVE 5): from there on a frame is what the target's
// camera would have taken and keyed, so that physics, light and the z-key need not know of it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/composite/actor_removal.h"
#include "server/composite/avatar_view.h"
#include "server/pipeline/avatar_target.h"
#include "server/pipeline/frame.h"
#include "server/raster/render_device.h"
#include "server/render/room_view.h"
#include "server/scene/avatar.h"
#include "server/segmentation/actor_stance.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

// The show that he comes from.
struct AvatarHome {
  const Rig* rig = nullptr;
  const RoomView* room = nullptr;  // null: not scanned
  float depth_sigma_m = 0;         // of that room
  bool posed = false;              // something says where the camera stands in its world
  RenderDevice device{};
};

class AvatarStage {
 public:
  // target: null = the show's own room. Fails (kInvalidConfig) where the show lacks what the avatar needs;
  // says what to change.
  static Result<AvatarStage> Create(const Avatar& avatar, const AvatarHome& home,
                                    std::unique_ptr<AvatarTarget> target, const PinholeCamera& view);

  // What of the own room the frame was keyed against.
  struct Own {
    RoomView* view = nullptr;          // null: not scanned
    const RoomDepth* depth = nullptr;  // of it
    ToneChange tone;
    const cv::Mat3b* foreground = nullptr;          // Key::foreground; null: nothing is keyed
    std::shared_ptr<const BackgroundModel> room{};  // null while the camera moves
  };
  // f: keyed, with the actor's surface. t_us: of the show. Sets T_world_view, and picture, alpha and
  // actor_depth_m to those of the view; where nothing says where the own camera stands, T_world_color too.
  void Run(const Avatar& avatar, std::int64_t t_us, const Own& own, Frame& f);

  // The camera of the composite.
  [[nodiscard]] const PinholeCamera& view() const { return view_; }
  // Of the last Run, [h x w] of the view, R, G, B: his own colour, known where 0 < alpha < 255.
  [[nodiscard]] const cv::Mat3b& foreground() const { return out_.foreground; }
  // Of the last Run: what stands around him; null: not known.
  [[nodiscard]] const RoomDepth* depth() const { return seen_.depth; }
  [[nodiscard]] const std::shared_ptr<const BackgroundModel>& room() const { return seen_.room; }

 private:
  AvatarStage(AvatarView drawing, std::unique_ptr<AvatarTarget> target, const PinholeCamera& view)
      : view_(view), drawing_(std::move(drawing)), target_(std::move(target)) {}
  // The own camera's picture without him.
  AvatarTarget::Seen SeeOwn(const Own& own, const Frame& f);

  PinholeCamera view_;
  AvatarView drawing_;
  std::unique_ptr<AvatarTarget> target_;  // null: what the own camera sees
  std::optional<ActorStance> stance_;     // where nothing else says where the own camera stands
  ActorRemoval removal_;
  std::uint64_t own_drawing_ = 0;
  YuvImage own_room_, own_empty_;
  AvatarTarget::Seen seen_;
  AvatarPicture out_;
};

}  // namespace mixstage
