// SPDX-License-Identifier: Apache-2.0
//
// The empty set out of a scanned room (MixIn3D 2.3, 2.4) instead of out of frames: mean and depth are the
// prediction, sigma is what the sensors' noise and the scan's own doubt amount to at each pixel.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/image_view.h"
#include "server/environment/room_prediction.h"
#include "server/segmentation/background_model.h"
#include "server/segmentation/half_picture.h"

namespace mixstage {

// How far a show's pictures lie from the prediction where they show the room: the sensors' noise and what the
// scan gets wrong everywhere. Measured in the pictures themselves, robustly (medians of absolute values):
// actors who cover less than half of each brightness and of each distance do not count.
class PredictionNoise {
 public:
  static constexpr int kLevels = 16;     // of brightness, 0..255
  static constexpr int kDistances = 40;  // half metres
  static constexpr int kMostFrames = 8;

  // A frame and the room predicted for its pose. depth_m [h x w] as for Key::Run; may be empty. Frames beyond
  // kMostFrames are ignored; sizes must agree (checked).
  void Add(const RoomPrediction& room, const HalfPicture& picture, ImageView<const float> depth_m);
  [[nodiscard]] bool complete() const { return frames_ >= kMostFrames; }
  [[nodiscard]] int frames() const { return frames_; }

  // Grey levels, > 0, of channel 0..2 = R, G, B where the room has this brightness; without frames a camera's
  // usual.
  [[nodiscard]] float color_sigma(std::size_t channel, int brightness) const;
  // Error of a colour where the room is patterned, per contrast there (both in grey levels): what is left of
  // the registration and of the camera's sharpness. Nothing without frames.
  [[nodiscard]] std::optional<float> per_contrast() const { return per_contrast_; }
  // Metres, > 0, of one measurement against D_M at this distance.
  [[nodiscard]] float depth_sigma_m(float z_m) const;

 private:
  void Summarise();

  int frames_ = 0;
  std::array<std::array<std::vector<float>, kLevels>, 3> color_seen_;  // one a frame that has enough pixels
  std::array<std::vector<float>, kDistances> depth_seen_;
  std::vector<float> per_contrast_seen_;
  std::array<std::array<float, kLevels>, 3> color_{};  // 0 = not measured
  std::array<float, kDistances> depth_{};
  std::optional<float> per_contrast_;
};

// The scan's own doubt.
struct PredictionDoubt {
  float registration_px = 0.3f;  // of colours, full pixels; until the pictures themselves tell it
  float depth_sigma_m = 0.005f;
};

// model: made anew; its pictures are used again where they have the size and nobody else holds them. room:
// not of size 0 (checked). What was never observed says nothing: neither colour nor depth speak for or
// against an actor.
void PredictBackground(const RoomPrediction& room, const PredictionNoise& noise, const PredictionDoubt& doubt,
                       BackgroundModel* model);

}  // namespace mixstage
