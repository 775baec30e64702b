// SPDX-License-Identifier: Apache-2.0
//
// A predicted room, made sharper where the camera stands. The scan says which of the show's pixels show the
// room; their mean is the room at the camera's own sharpness and place, their spread its own noise (piVE 3 eq
// 1-2). What it learns stays within the prediction's doubt: an actor who stands still is no more absorbed
// than he resembles the room.
#pragma once

#include <array>
#include <memory>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "server/segmentation/background_model.h"
#include "server/segmentation/half_picture.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

class RefinedBackground {
 public:
  static constexpr int kMostSamples = 20;
  static constexpr int kFewestSamples = 4;  // of a pixel: with fewer the prediction stands

  // Starts anew from the prediction of another pose. Costs nothing until the first Add.
  void Begin(std::shared_ptr<const BackgroundModel> predicted);
  // A frame of this pose as the key decided it against a model of this pose: its tone, half_mask [Half(h) x
  // Half(w)] > 0 actor, label [h x w]. Ignored when kMostSamples are there.
  void Add(const HalfPicture& picture, const ToneChange& tone, const cv::Mat1b& half_mask,
           ImageView<const std::uint8_t> label);
  [[nodiscard]] int samples() const { return samples_; }
  [[nodiscard]] bool complete() const { return samples_ >= kMostSamples; }

  // The prediction with what was learnt; depth and the unseen stay as predicted. model: made anew, as
  // PredictBackground makes it.
  void Refine(BackgroundModel* model) const;

 private:
  std::shared_ptr<const BackgroundModel> predicted_;
  int samples_ = 0;
  cv::Mat1b around_;                       // scratch
  cv::Mat1f count_;                        // [Half x Half]
  std::array<cv::Mat1f, 3> sum_, square_;  // of differences to the prediction, at its tone
};

}  // namespace mixstage
