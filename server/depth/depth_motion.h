// SPDX-License-Identifier: Apache-2.0
//
// Depth moved to the colour picture's instant (MixIn3D 3.1: 12.5 depth pictures a second against 30): what
// moved between the colour picture of depth's instant and this one took its depth along. A vector a block by
// hierarchical search with its neighbours' vectors as candidates (3DRS, de Haan 1993), then for every sample
// the best of the vectors around: the outline of what moves is the picture's own, not a block's.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/image_view.h"

namespace mixstage {

// The room without actors in the picture's view, a sample in 4x4 pixels: [(h+3)/4 x (w+3)/4]; empty = not
// known.
struct StandingRoom {
  ImageView<const float> depth_m;  // z, 0 = not known
  ImageView<const float> sigma_m;  // of one measurement of it
};

class DepthMotion {
 public:
  // One colour picture after the other: luma [h x w] and its instant. Sizes and steps back in time start
  // anew.
  void See(const cv::Mat1b& luma, std::int64_t capture_us);

  // D [h x w]: z in metres in the colour camera as measured at depth_us, 0 = unknown. moved, same size, out:
  // D at the instant of the last picture seen; unknown where the pictures do not tell where a surface came
  // from, or where the room would have moved: what was hidden resembles some other place of the floor.
  // Returns the age in seconds >= 0 that is left to moved: a share of D's, since vectors err too; all of it
  // where depth_us lies before the pictures remembered (0.25 s), and then moved is D. Allocates on a new size
  // only.
  double Run(ImageView<const float> D, std::int64_t depth_us, const StandingRoom& room, cv::Mat1f* moved);

 private:
  struct Vector {
    std::int16_t x, y;
  };
  struct Picture {
    std::int64_t capture_us = 0;
    std::vector<cv::Mat1b> levels;  // [0] = a quarter of the width and height
  };
  struct Field {  // one level's vectors, one a block
    int columns = 0, rows = 0;
    std::vector<Vector> vectors;
  };

  [[nodiscard]] const Picture* PictureAt(std::int64_t us) const;
  void Search(const Picture& now, const Picture& then, std::size_t level, cv::Rect box);
  void MoveSamples(const Picture& now, const Picture& then, cv::Rect box, double share,
                   ImageView<const float> D, const StandingRoom& room, cv::Mat1f* moved) const;

  std::vector<Picture> pictures_;  // a ring: next_ is the oldest
  std::size_t next_ = 0, last_ = 0;
  int seen_ = 0;
  std::vector<Field> fields_;  // of the levels, as the last search left them
  cv::Mat1b difference_, changed_;
};

}  // namespace mixstage
