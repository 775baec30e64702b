// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/fusion.h"

#include <algorithm>
#include <cstdint>

#include "proto/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/fusion.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#include "server/segmentation/bytes-inl.h"

#ifndef MIXSTAGE_FUSION_ROW_
#define MIXSTAGE_FUSION_ROW_
namespace mixstage {

struct FusionRow {
  const std::uint8_t* room;
  const std::uint8_t* room_around;
  const std::uint8_t* shadow;
  const std::uint8_t* depth;
  const std::uint8_t* inside;
  std::uint8_t* evidence;
  float actor_prior;
  float room_weight;
};

// A neighbourhood counts as "the room" from -1.5 log-odds on average, fully at -3.5.
inline constexpr float kRoomFrom = 1.5f;
inline constexpr float kRoomFully = 3.5f;
// A pixel that equals the room amid others that do not: little, an actor's colours meet the room's here and
// there.
inline constexpr float kLoneRoom = 1.5f;
inline constexpr float kLoneRoomInside = 0.5f;
inline constexpr float kLeastShadow = -6.0f;

}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class D>
HWY_INLINE void FuseAt(D d, const FusionRow& row, std::size_t x) {
  const auto zero = hn::Zero(d);
  const auto one = hn::Set(d, 1.0f);
  const auto room = LoadLogOdds(d, row.room + x);
  const auto around = LoadLogOdds(d, row.room_around + x);
  const auto shadow = LoadLogOdds(d, row.shadow + x);
  const auto inside = hn::Mul(LoadByte(d, row.inside + x), hn::Set(d, 1.0f / 255));
  const auto outside = hn::Sub(one, inside);

  const auto ramp =
      hn::Mul(hn::Sub(hn::Set(d, -kRoomFrom), around), hn::Set(d, 1 / (kRoomFully - kRoomFrom)));
  const auto sure = hn::Min(hn::Max(ramp, zero), one);
  const auto together = hn::Mul(hn::Mul(hn::Set(d, row.room_weight), sure), outside);
  const auto lone = hn::Mul(hn::Sub(one, sure), hn::MulAdd(hn::Set(d, kLoneRoom), outside,
                                                           hn::Mul(hn::Set(d, kLoneRoomInside), inside)));
  const auto is_room = hn::Neg(hn::Add(together, lone));

  const auto other = hn::Min(room, hn::Max(shadow, hn::Set(d, kLeastShadow)));
  const auto not_room = hn::IfThenElse(hn::Lt(other, zero), hn::Mul(other, outside), other);
  const auto color = hn::IfThenElse(hn::Lt(room, zero), is_room, not_room);
  const auto sum = hn::Add(hn::Add(color, LoadLogOdds(d, row.depth + x)), hn::Set(d, row.actor_prior));
  StoreLogOdds(d, sum, row.evidence + x);
}

void FuseRow(const FusionRow& row, std::size_t width) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  std::size_t x = 0;
  for (; x + lanes <= width; x += lanes) FuseAt(d, row, x);
  if (x < width && width >= lanes) {
    FuseAt(d, row, width - lanes);
  } else {
    for (; x < width; ++x) FuseAt(hn::CappedTag<float, 1>(), row, x);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(FuseRow);

void Fuse(const FusionInput& in, cv::Mat1b* evidence) {
  MIX_CHECK(in.room.size() == in.shadow.size() && in.room.size() == in.room_around.size());
  MIX_CHECK(in.room.size() == in.depth.size() && in.room.size() == in.inside.size());
  evidence->create(in.room.size());
  for (int y = 0; y < in.room.rows; ++y) {
    const FusionRow row = {.room = in.room.ptr<std::uint8_t>(y),
                           .room_around = in.room_around.ptr<std::uint8_t>(y),
                           .shadow = in.shadow.ptr<std::uint8_t>(y),
                           .depth = in.depth.ptr<std::uint8_t>(y),
                           .inside = in.inside.ptr<std::uint8_t>(y),
                           .evidence = evidence->ptr<std::uint8_t>(y),
                           .actor_prior = in.actor_prior,
                           .room_weight = in.room_weight};
    HWY_DYNAMIC_DISPATCH(FuseRow)(row, static_cast<std::size_t>(in.room.cols));
  }
}

void FuseScalar(const FusionInput& in, cv::Mat1b* evidence) {
  evidence->create(in.room.size());
  const auto log_odds = [](std::uint8_t byte) {
    return static_cast<float>(byte - kNoEvidence) * kEvidencePerByte;
  };
  for (int y = 0; y < in.room.rows; ++y) {
    for (int x = 0; x < in.room.cols; ++x) {
      const float room = log_odds(in.room(y, x));
      const float inside = static_cast<float>(in.inside(y, x)) / 255;
      float color = 0;
      if (room < 0) {
        const float sure =
            std::clamp((-kRoomFrom - log_odds(in.room_around(y, x))) / (kRoomFully - kRoomFrom), 0.0f, 1.0f);
        color = -(in.room_weight * sure * (1 - inside) +
                  (1 - sure) * (kLoneRoom * (1 - inside) + kLoneRoomInside * inside));
      } else {
        color = std::min(room, std::max(log_odds(in.shadow(y, x)), kLeastShadow));
        if (color < 0) color *= 1 - inside;  // depth deep inside: no shadow hangs in the air
      }
      const float sum = color + log_odds(in.depth(y, x)) + in.actor_prior;
      (*evidence)(y, x) =
          static_cast<std::uint8_t>(std::clamp(kNoEvidence + sum / kEvidencePerByte + 0.5f, 0.0f, 255.0f));
    }
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
