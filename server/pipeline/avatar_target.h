// SPDX-License-Identifier: Apache-2.0
//
// What stands around the avatar (piVE 5): a scanned room or a video with depth, as the target's camera sees
// it. Its world is that of the scene.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"
#include "proto/geometry/rig.h"
#include "proto/take/take.h"
#include "server/composite/z_key.h"
#include "server/depth/depth_warp.h"
#include "server/ingest/take_ingest.h"
#include "server/raster/render_device.h"
#include "server/render/room_view.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

class AvatarTarget {
 public:
  virtual ~AvatarTarget() = default;
  AvatarTarget() = default;
  AvatarTarget(const AvatarTarget&) = delete;
  AvatarTarget& operator=(const AvatarTarget&) = delete;

  struct Seen {
    RigidTransform T_world_view = RigidTransform::Identity();
    const YuvImage* picture = nullptr;
    const RoomDepth* depth = nullptr;
    // For edits and viewers: the same as a background model; null while the camera moves, and of a video.
    std::shared_ptr<const BackgroundModel> room{};
  };
  // t_us: of the show since its first frame, >= 0. T_world_color: where the show's camera stands in its own
  // world. layout: of the show's pictures; a video keeps its own. Valid until the next call.
  virtual Seen See(std::int64_t t_us, const RigidTransform& T_world_color, ChromaLayout layout) = 0;
};

// A scanned room through `view`; from `pose`, else from where the show's camera stands in its own world.
class RoomTarget final : public AvatarTarget {
 public:
  RoomTarget(RoomView view, float depth_sigma_m, std::optional<RigidTransform> pose)
      : view_(std::move(view)), depth_sigma_m_(depth_sigma_m), pose_(std::move(pose)) {}
  Seen See(std::int64_t t_us, const RigidTransform& T_world_color, ChromaLayout layout) override;

 private:
  RoomView view_;
  float depth_sigma_m_;
  std::optional<RigidTransform> pose_;
  std::uint64_t drawing_ = 0;
  YuvImage picture_;
  RoomDepth depth_;
  std::shared_ptr<const BackgroundModel> room_;
};

// The room's picture at full size with its thin gaps and what was never observed filled from around. view: as
// it looked last.
[[nodiscard]] cv::Mat3b WholePicture(RoomView& view, const RoomPrediction& prediction);

struct AvatarVideo {
  Take take;
  Rig rig;
  std::vector<PoseSample> poses;  // T_world_color by the take's time; empty = none
};

// A capture folder: its pictures in the show's time, from the first on, again and again. Its camera stands
// where its poses say, else its rig's pan-tilt unit, else over the floor that its depth shows.
class VideoTarget final : public AvatarTarget {
 public:
  // Fails where it has no depth, its first picture cannot be used, or nothing says where its camera stands.
  static Result<std::unique_ptr<VideoTarget>> Create(AvatarVideo video, const RenderDevice& device);
  Seen See(std::int64_t t_us, const RigidTransform& T_world_color, ChromaLayout layout) override;

 private:
  VideoTarget(AvatarVideo video, DepthWarp warp)
      : video_(std::move(video)), ingest_(video_.take, video_.rig), warp_(std::move(warp)) {}
  Status Show(int index);
  [[nodiscard]] RigidTransform PoseOf(const CapturedFrame& frame) const;

  AvatarVideo video_;
  TakeIngest ingest_;
  DepthWarp warp_;
  std::optional<RigidTransform> standing_;  // by the floor
  int shown_ = -1;
  std::shared_ptr<const CapturedFrame> frame_;
  std::shared_ptr<const DepthPicture> warped_;
  RoomDepth depth_;
};

}  // namespace mixstage
