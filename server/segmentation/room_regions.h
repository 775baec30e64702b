// SPDX-License-Identifier: Apache-2.0
//
// Garbage and hold-out regions as parts of the room instead of parts of the picture: they stay where they are
// while the camera turns, and an actor who walks in front of one is not cut.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

enum class RegionKind {
  kGarbage = 1,  // what is in there is never actor: a screen, a window, a corridor
  kHoldOut,  // what is in there is always kept as foreground: a desk that belongs to him. Wins over garbage
};

struct RoomRegion {
  std::string name;
  RegionKind kind = RegionKind::kGarbage;
  // The convex body of all points with n . x + d >= 0 for every plane (n, d), |n| = 1, metres; a box has six.
  std::vector<Eigen::Vector4d> planes;
};

enum class RegionFrame {
  kWorld = 1,
  kCamera,  // the colour camera's: for rigs whose camera stands somewhere unknown
};

struct RoomRegions {
  RegionFrame frame = RegionFrame::kWorld;
  std::vector<RoomRegion> regions;
};

// Which pixels see into a region. A pixel is in one when the surface that it shows lies in it: what depth
// measures there; where depth says nothing, the room's own surface; where that is not known either, the whole
// line of sight counts. Garbage gives way near everything that depth sees in front of it.
class RegionMask {
 public:
  // camera valid (checked).
  RegionMask(const PinholeCamera& camera, RoomRegions regions);

  // T_world_color  of the frame; the bodies are projected anew only where it changes
  // depth_m        [h x w]  D, z in metres, 0 = unknown; empty = none
  void Run(const RigidTransform& T_world_color, const BackgroundModel& model, ImageView<const float> depth_m);

  // Of the last Run, 255 or 0.
  [[nodiscard]] const cv::Mat1b& garbage() const { return garbage_; }  // [Half(h) x Half(w)]
  // Things that depth sees in a hold-out region in front of the room: they are actor whatever their colour.
  [[nodiscard]] const cv::Mat1b& things() const { return things_; }  // [Half(h) x Half(w)]
  // [h x w] alpha in/out, half_mask [Half(h) x Half(w)] in/out: nothing in garbage, all of the room's own
  // surface in a hold-out region; half_mask, of the actor alone, has no part in that.
  void Lay(ImageView<std::uint8_t> alpha, cv::Mat1b* half_mask) const;
  // surface_m [Half(h) x Half(w)] in/out: z of the actor; where he is not (0) and the room is held out, the
  // room's.
  void LayDepth(const BackgroundModel& model, cv::Mat1f* surface_m) const;

 private:
  struct Projected {
    RegionKind kind = RegionKind::kGarbage;
    cv::Rect box;   // quarter-size pixels that see into it
    cv::Mat2f z_m;  // [Quarter x Quarter] where the pixel's ray enters and leaves it; far <= near: never
    cv::Mat1b in_front;
  };
  void Project(const RigidTransform& T_region_color);
  void Keep(Projected& region, const BackgroundModel& model);
  void Bar(Projected& region, const BackgroundModel& model);

  PinholeCamera camera_;
  RoomRegions regions_;
  cv::Mat2f rays_;  // [Quarter x Quarter] (x/z, y/z)
  std::optional<RigidTransform> T_region_color_;
  std::vector<Projected> projected_;
  cv::Mat1f depth_m_;                                    // [Quarter x Quarter]
  cv::Mat1b garbage_small_, things_small_, held_small_;  // [Quarter x Quarter]
  cv::Mat1b garbage_, things_, held_;                    // [Half x Half]
  cv::Mat1b garbage_full_, held_full_;
};

}  // namespace mixstage
