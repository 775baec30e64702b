// SPDX-License-Identifier: Apache-2.0
//
// The synthetic set: a room, a man who walks through it, and the cameras of a rig that look at them from a
// head that can turn. Needs no hardware and no data; what the cameras see has an exact truth.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"
#include "proto/geometry/rig.h"
#include "proto/synthetic/color_view.h"
#include "proto/synthetic/room.h"
#include "proto/synthetic/standing_board.h"
#include "proto/synthetic/walk.h"

namespace mixstage {

struct SyntheticConfig {
  std::uint32_t seed = 1;  // of the sensors' noise
  SensorNoise noise = SensorNoise::kReal;
  bool figure = true;  // false: the set stays empty
};

enum class SyntheticCamera { kColor = 1, kDepth };

struct SyntheticTruth {
  float depth_m = 0;    // z in the camera asked
  bool figure = false;  // the figure, else the room
};

class SyntheticScene {
 public:
  // Renders the empty room: about a second. The rig's colour camera, and its depth camera and fisheye where
  // there are any; where they stand is SyntheticTWorldColor's answer (rig.h). Fails with kInvalidConfig where
  // a camera is not valid or wider than 8192 px.
  static Result<SyntheticScene> Create(const Rig& rig, const SyntheticConfig& config);
  SyntheticScene(SyntheticScene&&) noexcept;
  SyntheticScene& operator=(SyntheticScene&&) noexcept;
  ~SyntheticScene();

  // Turns the head to encoder angles (nothing turns where the rig has no pan-tilt unit, or has its head
  // outside the room) and puts boards into the room, in place of those before. What has changed is rendered
  // by the next picture of each camera: a second for the room from another pose, tenths for other boards in
  // the same.
  void Arrange(double pan_deg, double tilt_deg, std::vector<StandingBoard> boards = {});

  // The pictures at a time (seconds, any; the figure's play repeats every kLoop_s, the noise does not). The
  // same seed and time give the same bytes. Allocate nothing once the pictures have their size; one thread at
  // a time.
  void RenderColor(double time_s, YuvImage& out);
  // range [h x w]: counts of the rig's unit_m (z instead of range where the rig says so), 0 = no measurement;
  // amplitude [h x w]. The rig must have a depth camera (checked). May run beside RenderColor on another
  // thread.
  void RenderTof(double time_s, cv::Mat1w& range, cv::Mat1w& amplitude);
  // The rig must have a fisheye (checked). It sees the room and the boards, never the figure.
  void RenderFisheye(double time_s, YuvImage& out);

  // Truth, never sent anywhere. Exact in double precision; any thread.
  // What a ray (world, unit direction) meets first at a time.
  [[nodiscard]] Hit Trace(const Ray& ray, double time_s) const;  // boards too
  // At a pixel of a camera, at any subpixel place; nothing where the lens has no ray.
  [[nodiscard]] std::optional<SyntheticTruth> TruthAt(SyntheticCamera camera, double u, double v,
                                                      double time_s) const;
  // [h x w] z at pixel centres of the camera's own distorted view; 0 where the lens has no ray.
  [[nodiscard]] cv::Mat1f TruthDepth(SyntheticCamera camera, double time_s) const;
  // [h x w] colour camera: share of the pixel that the figure covers, 0..255, linear.
  [[nodiscard]] cv::Mat1b TruthMatte(double time_s) const;
  // [h x w] colour camera: 0 background, 1 actor, 2 shadow of the actor on the background (the room lost more
  // than a tenth of its light), as FORMATS' label.
  [[nodiscard]] cv::Mat1b TruthLabel(double time_s);
  [[nodiscard]] const RigidTransform& TruthPose() const;  // T_world_color
  // What the figure does; nothing while the set is empty.
  [[nodiscard]] std::optional<WalkState> FigureState(double time_s) const;

  [[nodiscard]] const Rig& rig() const;
  [[nodiscard]] const Room& room() const;

 private:
  struct Impl;
  explicit SyntheticScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mixstage
