// SPDX-License-Identifier: Apache-2.0
#include "server/depth/depth_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// The room within its noise.
constexpr float kRoomSigmas = 3;
constexpr int kFactor = 4;          // of the finest level: below a depth camera's own grid
constexpr std::size_t kLevels = 3;  // quarter, eighth, sixteenth
constexpr std::size_t kRemembered = 8;
constexpr std::int64_t kLongestUs = 250'000;
constexpr std::int64_t kSameInstantUs = 4'000;  // a walking actor moves by 6 mm
constexpr int kBlock = 8;                       // samples of its level
constexpr int kStride = 4;                      // from one block to the next
constexpr int kCoarseReach = 4;                 // of the full search on the coarsest level, its samples
// Grey levels. The mean of sixteen pixels: noise is far below.
constexpr int kChanged = 6;  // of a mean over 3x3 samples
constexpr int kUnlike = 12;  // a sample that differs so much from where it came from did not come from there
constexpr int kMargin = 8;   // samples around what changed: where it came from
constexpr double kDoubt = 0.5;  // share of a motion that its vector may be wrong by
constexpr int kStepCost = 16;   // of a vector that no neighbour has, in grey levels over the block

// Sum of |now - then| over a block; where it leaves `then` the border is repeated.
int BlockDifference(const cv::Mat1b& now, const cv::Mat1b& then, int x, int y, int dx, int dy) {
  const int width = std::min(kBlock, now.cols - x), height = std::min(kBlock, now.rows - y);
  int sum = 0;
  if (x + dx >= 0 && y + dy >= 0 && x + dx + kBlock <= then.cols && y + dy + kBlock <= then.rows &&
      width == kBlock) {
    for (int v = 0; v < height; ++v) {
      const std::uint8_t* a = now.ptr<std::uint8_t>(y + v) + x;
      const std::uint8_t* b = then.ptr<std::uint8_t>(y + v + dy) + x + dx;
      int row = 0;
      for (int u = 0; u < kBlock; ++u) row += std::abs(a[u] - b[u]);
      sum += row;
    }
    return sum;
  }
  for (int v = 0; v < height; ++v) {
    const std::uint8_t* a = now.ptr<std::uint8_t>(y + v) + x;
    const std::uint8_t* b = then.ptr<std::uint8_t>(std::clamp(y + v + dy, 0, then.rows - 1));
    for (int u = 0; u < width; ++u) sum += std::abs(a[u] - b[std::clamp(x + u + dx, 0, then.cols - 1)]);
  }
  return sum;
}

// Over 3x3 samples: one alone is alike by chance.
int SampleDifference(const cv::Mat1b& now, const cv::Mat1b& then, int x, int y, int dx, int dy) {
  int sum = 0;
  for (int v = -1; v <= 1; ++v) {
    const std::uint8_t* a = now.ptr<std::uint8_t>(std::clamp(y + v, 0, now.rows - 1));
    const std::uint8_t* b = then.ptr<std::uint8_t>(std::clamp(y + v + dy, 0, then.rows - 1));
    for (int u = -1; u <= 1; ++u) {
      const int weight = u == 0 && v == 0 ? 4 : 1;
      sum += weight *
             std::abs(a[std::clamp(x + u, 0, now.cols - 1)] - b[std::clamp(x + u + dx, 0, then.cols - 1)]);
    }
  }
  return sum / 12;
}

cv::Rect Grown(const cv::Rect& box, int margin, cv::Size within) {
  return cv::Rect(box.x - margin, box.y - margin, box.width + 2 * margin, box.height + 2 * margin) &
         cv::Rect({0, 0}, within);
}

// Depth that would come from (at + by, pixels) to sample `at` is the room's there and not the room's here.
bool IsMovedRoom(const StandingRoom& room, ImageView<const float> D, cv::Point at, cv::Point by) {
  if (room.depth_m.empty()) return false;
  const int u = std::clamp(kFactor * at.x + 1 + by.x, 0, D.width() - 1);
  const int v = std::clamp(kFactor * at.y + 1 + by.y, 0, D.height() - 1);
  const float z = D.row(v)[u];
  const float there = room.depth_m.row(v / kFactor)[u / kFactor];
  const float here = room.depth_m.row(at.y)[at.x];
  if (!(z > 0 && there > 0 && here > 0)) return false;
  const bool was_room = z > there - kRoomSigmas * room.sigma_m.row(v / kFactor)[u / kFactor];
  return was_room && std::abs(z - here) > kRoomSigmas * room.sigma_m.row(at.y)[at.x];
}

}  // namespace

void DepthMotion::See(const cv::Mat1b& luma, std::int64_t capture_us) {
  MIX_CHECK(luma.cols >= 16 && luma.rows >= 16);
  const cv::Size size((luma.cols + kFactor - 1) / kFactor, (luma.rows + kFactor - 1) / kFactor);
  pictures_.resize(kRemembered);
  if (seen_ > 0 && (pictures_[last_].levels[0].size() != size || pictures_[last_].capture_us >= capture_us)) {
    seen_ = 0;
  }
  Picture& picture = pictures_[next_];
  picture.capture_us = capture_us;
  picture.levels.resize(kLevels);
  cv::resize(luma, picture.levels[0], size, 0, 0, cv::INTER_AREA);
  for (std::size_t i = 1; i < kLevels; ++i) {
    const cv::Mat1b& finer = picture.levels[i - 1];
    cv::resize(finer, picture.levels[i], {(finer.cols + 1) / 2, (finer.rows + 1) / 2}, 0, 0, cv::INTER_AREA);
  }
  last_ = next_;
  next_ = (next_ + 1) % kRemembered;
  seen_ = std::min(seen_ + 1, static_cast<int>(kRemembered));
}

const DepthMotion::Picture* DepthMotion::PictureAt(std::int64_t us) const {
  const Picture* best = nullptr;
  for (int i = 0; i < seen_; ++i) {
    const Picture& picture = pictures_[(last_ + kRemembered - static_cast<std::size_t>(i)) % kRemembered];
    if (pictures_[last_].capture_us - picture.capture_us > kLongestUs) break;
    if (best == nullptr || std::abs(picture.capture_us - us) < std::abs(best->capture_us - us))
      best = &picture;
  }
  return best;
}

// The level's field inside box (samples of the level), from the coarser level's.
void DepthMotion::Search(const Picture& now, const Picture& then, std::size_t level, cv::Rect box) {
  const cv::Mat1b& a = now.levels[level];
  const cv::Mat1b& b = then.levels[level];
  Field& field = fields_[level];
  field.columns = (a.cols + kStride - 1) / kStride;
  field.rows = (a.rows + kStride - 1) / kStride;
  field.vectors.assign(static_cast<std::size_t>(field.columns * field.rows), Vector{0, 0});
  const auto at = [&](int column, int row) -> Vector& {
    return field.vectors[static_cast<std::size_t>(row * field.columns + column)];
  };
  const int right = std::min((box.x + box.width + kStride - 1) / kStride, field.columns);
  const int bottom = std::min((box.y + box.height + kStride - 1) / kStride, field.rows);
  for (int row = box.y / kStride; row < bottom; ++row) {
    for (int column = box.x / kStride; column < right; ++column) {
      const int x = std::max(column * kStride - (kBlock - kStride) / 2, 0);
      const int y = std::max(row * kStride - (kBlock - kStride) / 2, 0);
      Vector best{0, 0};
      int least = BlockDifference(a, b, x, y, 0, 0);
      const auto consider = [&](int dx, int dy, int cost) {
        if (dx == best.x && dy == best.y) return;
        const int difference = cost + BlockDifference(a, b, x, y, dx, dy);
        if (difference >= least) return;
        least = difference;
        best = {static_cast<std::int16_t>(dx), static_cast<std::int16_t>(dy)};
      };
      if (level + 1 == fields_.size()) {
        for (int dy = -kCoarseReach; dy <= kCoarseReach; ++dy) {
          for (int dx = -kCoarseReach; dx <= kCoarseReach; ++dx) consider(dx, dy, kStepCost);
        }
      } else {
        const Field& coarse = fields_[level + 1];
        for (const auto& [u, v] : {std::pair{0, 0}, {1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const int from_column = std::clamp(column / 2 + u, 0, coarse.columns - 1);
          const int from_row = std::clamp(row / 2 + v, 0, coarse.rows - 1);
          const Vector& from =
              coarse.vectors[static_cast<std::size_t>(from_row * coarse.columns + from_column)];
          consider(2 * from.x, 2 * from.y, 0);
        }
      }
      if (column > 0) consider(at(column - 1, row).x, at(column - 1, row).y, 0);
      if (row > 0) consider(at(column, row - 1).x, at(column, row - 1).y, 0);
      const Vector middle = best;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) consider(middle.x + dx, middle.y + dy, kStepCost);
      }
      at(column, row) = best;
    }
  }
}

void DepthMotion::MoveSamples(const Picture& now, const Picture& then, cv::Rect box, double share,
                              ImageView<const float> D, const StandingRoom& room, cv::Mat1f* moved) const {
  const cv::Mat1b& a = now.levels[0];
  const cv::Mat1b& b = then.levels[0];
  const Field& field = fields_[0];
  for (int y = box.y; y < box.y + box.height; ++y) {
    for (int x = box.x; x < box.x + box.width; ++x) {
      // What looks as it did stands: a still wall beside an actor keeps its depth.
      Vector best{0, 0};
      int least = SampleDifference(a, b, x, y, 0, 0) - 2;
      const int column = x / kStride, row = y / kStride;
      if (least > 0) {
        for (int v = std::max(row - 1, 0); v <= std::min(row + 1, field.rows - 1); ++v) {
          for (int u = std::max(column - 1, 0); u <= std::min(column + 1, field.columns - 1); ++u) {
            const Vector& vector = field.vectors[static_cast<std::size_t>(v * field.columns + u)];
            if ((vector.x == 0 && vector.y == 0) || (vector.x == best.x && vector.y == best.y)) continue;
            const int difference = SampleDifference(a, b, x, y, vector.x, vector.y);
            if (difference < least) least = difference, best = vector;
          }
        }
      }
      if (best.x == 0 && best.y == 0 && least <= kUnlike) continue;
      const int dx = static_cast<int>(std::lround(kFactor * best.x * share));
      const int dy = static_cast<int>(std::lround(kFactor * best.y * share));
      const bool lost = least > kUnlike || IsMovedRoom(room, D, {x, y}, {dx, dy});
      const int left = kFactor * x, right = std::min(left + kFactor, D.width());
      for (int v = kFactor * y; v < std::min(kFactor * y + kFactor, D.height()); ++v) {
        float* out = moved->ptr<float>(v);
        if (lost || v + dy < 0 || v + dy >= D.height()) {
          std::fill(out + left, out + right, 0.0f);
          continue;
        }
        const float* from = D.row(v + dy);
        for (int u = left; u < right; ++u) out[u] = u + dx >= 0 && u + dx < D.width() ? from[u + dx] : 0.0f;
      }
    }
  }
}

double DepthMotion::Run(ImageView<const float> D, std::int64_t depth_us, const StandingRoom& room,
                        cv::Mat1f* moved) {
  MIX_CHECK(moved != nullptr && seen_ > 0 && !D.empty());
  const Picture& now = pictures_[last_];
  MIX_CHECK((D.width() + kFactor - 1) / kFactor == now.levels[0].cols &&
            (D.height() + kFactor - 1) / kFactor == now.levels[0].rows);
  MIX_CHECK(room.depth_m.empty() ||
            (room.depth_m.width() == now.levels[0].cols && room.depth_m.height() == now.levels[0].rows &&
             SameSize(room.depth_m, room.sigma_m)));
  moved->create(D.height(), D.width());
  for (int y = 0; y < D.height(); ++y)
    std::memcpy(moved->ptr<float>(y), D.row(y), static_cast<std::size_t>(D.width()) * sizeof(float));
  const std::int64_t age_us = std::max<std::int64_t>(now.capture_us - depth_us, 0);
  const Picture& then = *PictureAt(depth_us);
  const std::int64_t between_us = now.capture_us - then.capture_us;
  if (age_us <= kSameInstantUs || between_us <= 0 || age_us > kLongestUs ||
      std::abs(then.capture_us - depth_us) > between_us) {
    return static_cast<double>(age_us) * 1e-6;
  }
  cv::absdiff(now.levels[0], then.levels[0], difference_);
  cv::blur(difference_, difference_, {3, 3});
  cv::compare(difference_, kChanged, changed_, cv::CMP_GE);
  const cv::Rect changed = cv::boundingRect(changed_);
  const double age_left_s = kDoubt * static_cast<double>(age_us) * 1e-6;
  if (changed.empty()) return age_left_s;
  fields_.resize(kLevels);
  for (std::size_t level = kLevels; level-- > 0;) {
    const int scale = 1 << level;
    const cv::Rect box(changed.x / scale, changed.y / scale, changed.width / scale + 1,
                       changed.height / scale + 1);
    Search(now, then, level, Grown(box, kMargin >> level, now.levels[level].size()));
  }
  const double share = static_cast<double>(age_us) / static_cast<double>(between_us);
  MoveSamples(now, then, Grown(changed, 1, now.levels[0].size()), share, D, room, moved);
  return age_left_s;
}

}  // namespace mixstage
