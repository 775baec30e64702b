// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "server/environment/environment_folder.h"
#include "server/raster/rasteriser.h"
#include "server/render/mirror.h"

namespace mixstage {

// The scanned room as a mirror shows it: its radiance in linear light, 1.0 = the picture's white, and its
// depth. On this processor; drawn while the camera or the mirror moves only.
class MirroredRoom {
 public:
  // room is valid (checked). What is nearer to the mirror than its noise is the mirror itself.
  MirroredRoom(const RoomModel& room, float sigma_m, const PinholeCamera& mirrored);

  // Both pictures are the window of the mirrored camera's; 0 where the scan knows nothing. rays: of the whole
  // picture, (x/z, y/z). World frame.
  void Draw(const MirrorView& view, const cv::Rect& window, const cv::Mat2f& rays, cv::Mat3f& radiance,
            cv::Mat1f& depth_m);

 private:
  std::vector<Eigen::Vector3f> positions_;
  std::vector<Eigen::Vector2f> uvs_;
  std::vector<std::uint32_t> indices_;
  cv::Mat3b texture_bgr_;
  float off_m_ = 0;
  std::unique_ptr<Rasteriser> rasteriser_;
};

}  // namespace mixstage
