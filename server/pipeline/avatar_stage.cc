// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/avatar_stage.h"

#include <utility>

#include "proto/base/check.h"

namespace mixstage {

Result<AvatarStage> AvatarStage::Create(const Avatar& avatar, const AvatarHome& home,
                                        std::unique_ptr<AvatarTarget> target, const PinholeCamera& view) {
  PinholeCamera lens = view;
  if (target == nullptr) {
    if (home.room == nullptr) {
      return Fail(
          ErrorCode::kInvalidConfig,
          "avatar: the show's own room is not scanned: give --environment, or avatar.room or avatar.video "
          "in the scene");
    }
    if (avatar.camera) {
      auto pose = TTargetView(*avatar.camera);
      if (!pose) return Within("avatar.camera.look_at", pose.error());
      Rig rig = *home.rig;
      lens = rig.color = LensOf(*avatar.camera, home.rig->color);
      auto room = home.room->Beside(rig, home.device);
      if (!room) return Within("avatar.camera", room.error());
      target = std::make_unique<RoomTarget>(std::move(*room), home.depth_sigma_m, *pose);
    }
  } else if (!home.posed && avatar.video.empty() && !avatar.camera) {
    return Fail(ErrorCode::kInvalidConfig,
                "avatar: nothing says where the show's camera stands (a rig with \"ptu\", or --poses): give "
                "avatar.camera");
  }
  auto drawing = AvatarView::Create(home.rig->color, lens, home.device);
  if (!drawing) return tl::unexpected(drawing.error());
  AvatarStage stage(std::move(*drawing), std::move(target), lens);
  if (!home.posed) stage.stance_.emplace(home.rig->color);
  return stage;
}

AvatarTarget::Seen AvatarStage::SeeOwn(const Own& own, const Frame& f) {
  MIX_CHECK(own.view != nullptr);
  const YuvImage& color = f.captured->color;
  const RoomPrediction& prediction = own.view->Look(f.T_world_color);
  if (own_drawing_ != prediction.drawing || own_room_.layout != color.layout) {
    own_drawing_ = prediction.drawing;
    own_room_ = FromBgr(WholePicture(*own.view, prediction), color.layout);
  }
  removal_.Run(color, own_room_, View(std::as_const(f.alpha)), View(std::as_const(f.label)),
               {own.tone.luma_gain(), own.tone.luma_offset()}, own_empty_);
  return {f.T_world_color, &own_empty_, own.depth, own.room};
}

void AvatarStage::Run(const Avatar& avatar, std::int64_t t_us, const Own& own, Frame& f) {
  bool placed = true;
  if (stance_) {
    stance_->See(View(std::as_const(f.actor_depth_m)));
    placed = stance_->T_world_color().has_value();
    f.T_world_color = stance_->T_world_color().value_or(RigidTransform::Identity());
  }
  seen_ = target_ != nullptr ? target_->See(t_us, f.T_world_color, f.captured->color.layout) : SeeOwn(own, f);
  f.T_world_view = seen_.T_world_view;
  if (!placed) f.alpha.setTo(0);
  drawing_.Run({.color = &f.captured->color,
                .alpha = View(std::as_const(f.alpha)),
                .foreground = own.foreground,
                .actor_depth_m = View(std::as_const(f.actor_depth_m)),
                .T_view_color = f.T_world_view.inverse() * avatar.TTargetWorld() * f.T_world_color},
               {.picture = seen_.picture, .depth = seen_.depth}, out_);
  // A frame owns its pictures: the buffers change places.
  std::swap(f.view_picture, out_.picture);
  std::swap(f.alpha, out_.alpha);
  f.actor_depth_m = out_.actor_depth_m;
}

}  // namespace mixstage
