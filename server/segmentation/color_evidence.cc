// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/color_evidence.h"

#include <algorithm>
#include <cmath>

#include "server/segmentation/color_evidence_constants.h"

namespace mixstage {
namespace {

std::uint8_t ToByte(float log_odds) {
  return static_cast<std::uint8_t>(
      std::clamp(static_cast<float>(kNoEvidence) + log_odds / kEvidencePerByte + 0.5f, 0.0f, 255.0f));
}

}  // namespace

void FindColorEvidenceScalar(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                             const ShadowConfig& config, const cv::Mat1f& texture, const cv::Mat1b& actor,
                             ColorEvidence* evidence) {
  evidence->room.create(picture.height(), picture.width());
  evidence->shadow.create(picture.height(), picture.width());
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = 0; x < picture.width(); ++x) {
      const std::array<float, 3> I_t = {static_cast<float>(picture.r(y, x)),
                                        static_cast<float>(picture.g(y, x)),
                                        static_cast<float>(picture.b(y, x))};
      std::array<float, 3> I_m{}, variance{};
      float D_t = 0;  // squared
      float along = 0, length = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        I_m[c] = std::clamp(tone.gain[c] * model.mean[c](y, x) + tone.offset[c], 0.0f, 255.0f);
        const float moved = kToneDoubt * (I_m[c] - model.mean[c](y, x));
        variance[c] = model.variance[c](y, x) * std::max(tone.gain[c], 1.0f) * std::max(tone.gain[c], 1.0f) +
                      moved * moved;
        // piVE eq (3)-(4): the distance to the room, each channel in units of its own sigma instead of their
        // sum.
        float difference = I_t[c] - I_m[c];
        // A clipped pixel of the room is at least as bright as it looks: only darker is different.
        if (model.mean[c](y, x) > kClipped) difference = std::min(difference, 0.0f);
        D_t += difference * difference / variance[c];
        along += I_t[c] * I_m[c] / variance[c];
        length += I_m[c] * I_m[c] / variance[c];
      }
      const float own = static_cast<float>(actor(y, x) - kNoEvidence) * kEvidencePerByte;
      evidence->room(y, x) = ToByte(kColorTail * std::min(D_t, kFarthest) + model.log_peak_room(y, x) + own);

      // piVE eq (5)-(8) in another form: I_t and s I_m have the same normalised rgb where only brightness
      // changed, and the distance is measured where its noise is known, before the division. (piVE's sentence
      // after eq (8) says that a distance above the threshold is background: a misprint, below.)
      const float s = along / std::max(length, 1e-3f);
      float chroma = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const float tolerance = config.chroma_tolerance * (1 - s) * I_m[c];
        const float difference = I_t[c] - s * I_m[c];
        chroma += difference * difference / (variance[c] + tolerance * tolerance);
      }
      const float cost = config.darkness_cost * std::max(config.usual_least - s, 0.0f) +
                         kBrighterCost * std::max(s - kBrighter, 0.0f);
      evidence->shadow(y, x) = ToByte(kShadowTail * std::min(chroma, kFarthest) +
                                      model.log_peak_shadow(y, x) + cost + texture(y / 2, x / 2) + own);
    }
  }
}

}  // namespace mixstage
