// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/key.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "server/segmentation/enlarge.h"
#include "server/segmentation/fusion.h"
#include "server/segmentation/labels.h"

namespace mixstage {
namespace {

// One step of decision to one of alpha: an edge of evidence (+-1 log-odd) runs from 0 to 255.
constexpr float kAlphaPerByte = 8.0f;

// Depth's log-odds from which it counts as "the room" for colour, and fully.
constexpr float kDepthFrom = 0.75f, kDepthFully = 2.25f;
// Log-odds of "the room in another light" for what has the room's texture (ShadowTexture's kept), more where
// depth sees the room and the likeness is beyond chance; and where it sees the room at all: of a dark colour,
// and of any, though a clear one still beats depth by a log-odd.
constexpr float kKept = 3.0f, kKeptOfRoom = 24.0f, kChance = 0.4f, kDarkRoom = 5.0f, kMirrored = 3.5f;
constexpr float kNothingSaid = 8.0f, kSurelyRoom = -5.0f;

// Log-odds [Quarter x Quarter] -> bytes at half size.
void EnlargeEvidence(const cv::Mat1f& from, float scale, float offset, cv::Size half, cv::Mat1b* small,
                     cv::Mat1b* to) {
  from.convertTo(*small, CV_8U, scale, offset);
  to->create(half);
  EnlargeTwice(*small, View(*to));
}

// Nearly all of the picture: its colours say nothing.
bool IsClipped(const HalfPicture& picture) {
  constexpr int kStep = 8, kClippedFrom = 246;
  int all = 0, clipped = 0;
  for (int y = 0; y < picture.height(); y += kStep) {
    for (int x = 0; x < picture.width(); x += kStep) {
      ++all;
      clipped += std::min({picture.r(y, x), picture.g(y, x), picture.b(y, x)}) >= kClippedFrom ? 1 : 0;
    }
  }
  return clipped > 0.9 * all;
}

}  // namespace

Result<Key> Key::Create(const KeyConfig& c) {
  for (const float value :
       {c.actor_prior, c.room_weight, c.own_weight, c.shadow.darkness_cost, c.depth.most, c.depth.least}) {
    if (!std::isfinite(value) || std::abs(value) > 100) {
      return Fail(ErrorCode::kInvalidConfig, "the key's log-odds must be finite and within 100");
    }
  }
  if (c.own_weight < 0 || c.room_weight < 0) {
    return Fail(ErrorCode::kInvalidConfig, "own_weight and room_weight must be >= 0");
  }
  if (!(c.depth.most > 0 && c.depth.least < 0 && c.depth.actor_speed_m_s >= 0)) {
    return Fail(ErrorCode::kInvalidConfig,
                "depth.most must be > 0, depth.least < 0, depth.actor_speed_m_s >= 0");
  }
  if (!(c.shadow.chroma_tolerance >= 0 && c.shadow.chroma_tolerance <= 1 && c.shadow.usual_least >= 0 &&
        c.shadow.usual_least <= 1)) {
    return Fail(ErrorCode::kInvalidConfig, "shadow.chroma_tolerance and shadow.usual_least must lie in 0..1");
  }
  if (!(c.regions.least_actor_share >= 0 && c.regions.least_actor_share < 1 &&
        c.regions.largest_hole_share >= 0 && c.regions.largest_hole_share < 1)) {
    return Fail(ErrorCode::kInvalidConfig, "regions: shares of the picture must lie in 0..1");
  }
  return Key(c);
}

void Key::Run(const BackgroundModel& model, ImageView<const std::uint8_t> luma, const HalfPicture& picture,
              ImageView<const float> depth_m, float depth_age_s, ImageView<std::uint8_t> label,
              ImageView<std::uint8_t> alpha, const RegionMask* regions) {
  const cv::Size half(Half(model.width), Half(model.height));
  MIX_CHECK(picture.r.size() == half && model.mean[0].size() == half);
  MIX_CHECK(label.width() == model.width && label.height() == model.height && SameSize(label, alpha) &&
            SameSize(label, luma));
  MIX_CHECK(depth_age_s >= 0);
  if (!actor_around_.empty() && actor_around_.size() != half) actor_around_.release();

  tone_ = FindToneChange(picture, model.mean, actor_around_);
  shadow_texture_.Run(picture, model, tone_, &texture_, &kept_);
  actor_colors_.Rate(picture, &likelihood_);
  if (!depth_m.empty() && model.has_depth()) {
    depth_evidence_.Run(depth_m, depth_age_s, model, config_.depth);
    BelieveTexture(depth_evidence_.log_odds());
    EnlargeEvidence(depth_evidence_.log_odds(), 1 / kEvidencePerByte, kNoEvidence, half, &depth_small_,
                    &depth_);
    EnlargeEvidence(depth_evidence_.inside(), 255, 0, half, &inside_small_, &inside_);
  } else {
    BelieveTexture(cv::Mat1f(kept_.size(), 0.0f));
    depth_.create(half);
    inside_.create(half);
    depth_.setTo(kNoEvidence);
    inside_.setTo(0);
  }
  FindColorEvidence(picture, model, tone_, config_.shadow, texture_, likelihood_, &color_);
  if (IsClipped(picture)) {
    color_.room.setTo(kNoEvidence);
    color_.shadow.setTo(kNoEvidence);
  }
  EnlargeEvidence(most_, 1 / kEvidencePerByte, kNoEvidence, half, &most_small_, &most_bytes_);
  cv::min(cv::InputArray(color_.shadow), most_bytes_, color_.shadow);
  // Of the windows that hold a pixel the one that is most of all the room: others reach across an outline,
  // and a gap between arm and body is narrow.
  room_mean_.Run(color_.room, &room_around_);
  cv::erode(room_around_, room_around_, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  Fuse({color_.room, room_around_, color_.shadow, depth_, inside_, config_.actor_prior, config_.room_weight},
       &evidence_);
  if (regions != nullptr) {
    evidence_.setTo(0, regions->garbage());
    evidence_.setTo(255, regions->things());
  }
  neighbor_vote_.Run(evidence_, picture, model, tone_, config_.own_weight, &decision_);
  region_filter_.Run(evidence_, config_.regions, &decision_);
  Decide(model);
  edge_coverage_.Run(luma, picture, model, tone_, &half_alpha_, &half_mask_, alpha);
  if (regions != nullptr) regions->Lay(alpha, &half_mask_);
  cv::erode(half_mask_, core_, cv::getStructuringElement(cv::MORPH_RECT, {9, 9}));
  actor_colors_.Learn(picture, core_, evidence_);
  cv::dilate(half_mask_, actor_around_, cv::getStructuringElement(cv::MORPH_RECT, {9, 9}));
  WriteLabels(alpha, half_shadow_, label);
}

// What has the room's texture is the room in another light, most of all where depth sees the room too: under
// a foot, in what a table reflects. There a shadow may also be as dark as it likes, and what is mirrored has
// its own colours and edges.
void Key::BelieveTexture(const cv::Mat1f& depth) {
  most_.create(kept_.size());
  for (int y = 0; y < most_.rows; ++y) {
    const float* log_odds = depth.ptr<float>(y);
    const float* kept = kept_.ptr<float>(y);
    float* __restrict texture = texture_.ptr<float>(y);
    float* __restrict most = most_.ptr<float>(y);
    for (int x = 0; x < most_.cols; ++x) {
      const float room = std::clamp((-log_odds[x] - kDepthFrom) / (kDepthFully - kDepthFrom), 0.0f, 1.0f);
      texture[x] -= kDarkRoom * room;
      const float claim =
          kMirrored * room + kKept * kept[x] + kKeptOfRoom * room * std::max(kept[x] - kChance, 0.0f);
      most[x] = std::max(kNothingSaid - claim, kSurelyRoom);
    }
  }
}

void Key::Decide(const BackgroundModel& model) {
  const cv::Size half = model.mean[0].size();
  half_shadow_.create(half);
  // Coverage before the outline is placed: an edge of evidence (+-1 log-odd) runs from 0 to 255.
  decision_.convertTo(half_alpha_, CV_8U, kAlphaPerByte, 128 - kAlphaPerByte * kNoEvidence);
  cv::threshold(decision_, half_mask_, kNoEvidence, 255, cv::THRESH_BINARY);
  // Third label of piVE 3: changed, and "the room, darkened" explains it better than "the room" does.
  for (int y = 0; y < half.height; ++y) {
    const std::uint8_t* room = color_.room.ptr<std::uint8_t>(y);
    const std::uint8_t* dark = color_.shadow.ptr<std::uint8_t>(y);
    std::uint8_t* shadow = half_shadow_.ptr<std::uint8_t>(y);
    for (int x = 0; x < half.width; ++x) {
      const bool is_shadow = (room[x] > kNoEvidence) & (dark[x] + 16 < room[x]);
      shadow[x] = is_shadow ? std::uint8_t{kLabelShadow} : std::uint8_t{kLabelBackground};
    }
  }
  cv::medianBlur(half_shadow_, half_shadow_, 3);
  if (model.seen.empty()) return;
  for (int y = 0; y < half.height; ++y) {
    const std::uint8_t* seen = model.seen.ptr<std::uint8_t>(y);
    std::uint8_t* label = half_shadow_.ptr<std::uint8_t>(y);
    for (int x = 0; x < half.width; ++x) label[x] = seen[x] == 0 ? std::uint8_t{kLabelUnknown} : label[x];
  }
}

}  // namespace mixstage
