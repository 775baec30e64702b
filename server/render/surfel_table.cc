// SPDX-License-Identifier: Apache-2.0
#include "server/render/surfel_table.h"

#include <algorithm>
#include <numbers>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/surfel_table.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#ifndef MIXSTAGE_SURFEL_TABLE_
#define MIXSTAGE_SURFEL_TABLE_
namespace mixstage {
namespace {

constexpr std::size_t kLanes = 16;

struct SurfelRun {
  std::array<const float*, 7> numbers;
  std::size_t count;  // a multiple of kLanes
  float position[3], normal[3];
};

}  // namespace
}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

// Plain loops over lanes: the compiler makes vectors of each target's width of them.
float HiddenBy(const SurfelRun& run) {
  const auto& [cx, cy, cz, fx, fy, fz, area] = run.numbers;
  float sums[kLanes] = {};
  for (std::size_t first = 0; first < run.count; first += kLanes) {
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::size_t i = first + k;
      const float x = cx[i] - run.position[0], y = cy[i] - run.position[1], z = cz[i] - run.position[2];
      const float above = std::max(0.0f, x * run.normal[0] + y * run.normal[1] + z * run.normal[2]);
      const float faces = std::max(0.0f, -(x * fx[i] + y * fy[i] + z * fz[i]));
      // cos cos area / (pi d^2 + area)
      const float d2 = x * x + y * y + z * z;
      sums[k] += above * faces / (d2 * (std::numbers::pi_v<float> * d2 + area[i]) + 1e-12f);
    }
  }
  float sum = 0;
  for (const float each : sums) sum += each;
  return sum;
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(HiddenBy);

void SurfelTable::Clear() {
  for (std::vector<float>& list : numbers_) list.clear();
  closed_ = 0;
}

void SurfelTable::Add(const Surfel& surfel) {
  for (std::size_t k = 0; k < 3; ++k) {
    numbers_[k].push_back(surfel.center[static_cast<Eigen::Index>(k)]);
    numbers_[k + 3].push_back(surfel.facing[static_cast<Eigen::Index>(k)]);
  }
  numbers_[6].push_back(surfel.facing.norm());
}

SurfelTable::Range SurfelTable::Close() {
  // Nothing fills the last lanes: it faces nobody.
  const std::size_t end = (numbers_[0].size() + kLanes - 1) / kLanes * kLanes;
  for (std::vector<float>& list : numbers_) list.resize(end, 0.0f);
  return {std::exchange(closed_, end), end};
}

float SurfelTable::Hidden(const Range& range, const Eigen::Vector3f& position,
                          const Eigen::Vector3f& normal) const {
  SurfelRun run{.numbers = {},
                .count = range.end - range.begin,
                .position = {position.x(), position.y(), position.z()},
                .normal = {normal.x(), normal.y(), normal.z()}};
  for (std::size_t k = 0; k < run.numbers.size(); ++k) run.numbers[k] = numbers_[k].data() + range.begin;
  return HWY_DYNAMIC_DISPATCH(HiddenBy)(run);
}

}  // namespace mixstage
#endif  // HWY_ONCE
