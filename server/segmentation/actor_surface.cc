// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// Noise of one measurement where the room says nothing about the sensor: a share of distance squared.
constexpr float kSigmaPerMetre = 0.006f;
// In front of the room by this many sigma: below, a late or mixed pixel of the wall.
constexpr float kInFront = 2.0f;
// A pixel is flying when fewer than this many of its eight neighbours lie on its surface.
constexpr int kCompanions = 3;
// An outstretched arm reaches this far behind or before the body.
constexpr float kBodyDepth_m = 0.7f;
// Of his motion along the view: depth pixels a side of one vote, and votes that count as much as all of him.
constexpr int kSpeedBlock = 16;
constexpr std::size_t kFewSteps = 128;
constexpr float kFastest_m_s = 5.0f;
constexpr double kLongestStep_s = 0.3;  // between two depth pictures, or from one to a colour picture

float SigmaAt(const BackgroundModel& model, float z, int x, int y) {
  const float by_distance = kSigmaPerMetre * z * z;
  if (!model.has_depth() || model.room_depth_m(y, x) <= 0) return by_distance;
  // The room's noise was measured at its own distance; an actor in front of it is nearer.
  const float ratio = z / model.room_depth_m(y, x);
  return std::max(model.sigma_m(y, x) * std::min(ratio * ratio, 1.0f), 0.25f * by_distance);
}

// Any of the four half-size pixels.
bool Covered(const cv::Mat1b& mask, int x, int y) {
  const std::uint8_t* top = mask.ptr<std::uint8_t>(2 * y);
  const std::uint8_t* bottom = mask.ptr<std::uint8_t>(std::min(2 * y + 1, mask.rows - 1));
  const int left = 2 * x, right = std::min(2 * x + 1, mask.cols - 1);
  return (top[left] | top[right] | bottom[left] | bottom[right]) != 0;
}

}  // namespace

Result<ActorSurface> ActorSurface::Create(const ActorSurfaceConfig& config) {
  if (!(config.same_surface_m > 0 && config.same_surface_m < 10) || config.smoothing_rounds < 0 ||
      config.smoothing_rounds > 4) {
    return Fail(ErrorCode::kInvalidConfig, "same_surface_m must lie in 0..10 and smoothing_rounds in 0..4");
  }
  return ActorSurface(config);
}

void ActorSurface::Run(const cv::Mat1b& mask, ImageView<const float> depth_m, const BackgroundModel& model,
                       const DepthInstant& instant) {
  surface_.create(mask.size());
  if (depth_m.empty() || cv::countNonZero(mask) == 0) {
    has_before_ = false;
    last_m_ = 0;
    surface_.setTo(0);
    return;
  }
  MIX_CHECK(mask.cols == Half(depth_m.width()) && mask.rows == Half(depth_m.height()));
  MIX_CHECK(!model.has_depth() || (model.width == depth_m.width() && model.height == depth_m.height()));
  QuarterDepth(depth_m, &depth_);
  mask_.create(depth_.size());
  for (int y = 0; y < mask_.rows; ++y) {
    for (int x = 0; x < mask_.cols; ++x) mask_(y, x) = Covered(mask, x, y) ? 255 : 0;
  }
  // Linear enlarging reads one pixel beyond the mask: that ring is filled too.
  cv::dilate(mask_, around_, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  box_ = cv::boundingRect(around_);
  if (box_.empty()) {
    has_before_ = false;
    surface_.setTo(0);
    return;
  }
  std::size_t levels = 1;
  for (int size = std::max(depth_.cols, depth_.rows); size > 1; size = Half(size)) ++levels;
  sum_.resize(levels);
  count_.resize(levels);
  KeepActor(model);
  DropFlying();
  for (int round = 0; round < config_.smoothing_rounds; ++round) Smooth(round + 1);
  LearnSpeed(instant.measured_us);
  FillHoles();
  StandSomewhere(model);
  Advance(instant.age_s);
  cv::resize(depth_, surface_, {2 * depth_.cols, 2 * depth_.rows}, 0, 0, cv::INTER_LINEAR);
  if (surface_.size() != mask.size()) surface_ = surface_(cv::Rect({0, 0}, mask.size())).clone();
  for (int y = 0; y < mask.rows; ++y) {
    const std::uint8_t* inside = mask.ptr<std::uint8_t>(y);
    float* z = surface_.ptr<float>(y);
    for (int x = 0; x < mask.cols; ++x) z[x] = inside[x] != 0 ? z[x] : 0.0f;
  }
}

// Inside the mask and in front of the room: a wall that a late depth frame shows there is not him. Where D_M
// is not known only what lies near his known depth is believed.
void ActorSurface::KeepActor(const BackgroundModel& model) {
  sigma_.create(depth_.size());
  sum_[0].create(depth_.size());
  count_[0].create(depth_.size());
  for (int y = 0; y < depth_.rows; ++y) {
    for (int x = 0; x < depth_.cols; ++x) {
      float& z = depth_(y, x);
      if (mask_(y, x) == 0) z = 0;
      const float room = model.has_depth() ? model.room_depth_m(y, x) : 0.0f;
      if (z > 0) sigma_(y, x) = SigmaAt(model, z, x, y);
      if (room > 0 && room - z <= kInFront * model.sigma_m(y, x)) z = 0;
      const bool sure = z > 0 && (room > 0 || !model.has_depth());
      sum_[0](y, x) = sure ? z : 0.0f;
      count_[0](y, x) = sure ? 1.0f : 0.0f;
    }
  }
  if (!model.has_depth()) return;
  BuildPyramid();
  for (int y = box_.y; y < box_.br().y; ++y) {
    for (int x = box_.x; x < box_.br().x; ++x) {
      float& z = depth_(y, x);
      if (z <= 0 || model.room_depth_m(y, x) > 0) continue;
      const float known = FromPyramid(x, y, 2);
      if (known > 0 && z - known > kBodyDepth_m) z = 0;
    }
  }
}

// Mixed pixels at silhouettes hang alone between actor and wall.
void ActorSurface::DropFlying() {
  scratch_.create(depth_.size());
  depth_.copyTo(scratch_);
  for (int y = box_.y; y < box_.br().y; ++y) {
    for (int x = box_.x; x < box_.br().x; ++x) {
      const float z = scratch_(y, x);
      if (z <= 0) continue;
      const float near = std::min(config_.same_surface_m, std::max(4 * sigma_(y, x), 0.03f));
      int companions = 0;
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, depth_.rows - 1); ++v) {
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, depth_.cols - 1); ++u) {
          companions += scratch_(v, u) > 0 && std::abs(scratch_(v, u) - z) < near ? 1 : 0;
        }
      }
      if (companions - 1 < kCompanions) depth_(y, x) = 0;
    }
  }
}

// Weighted mean over 5x5, step apart, of what may be the same surface: a body's curvature over 20 colour
// pixels is far below a ToF camera's noise, the step from arm to body is above it.
void ActorSurface::Smooth(int step) {
  depth_.copyTo(scratch_);
  for (int y = box_.y; y < box_.br().y; ++y) {
    const int top = y - std::min(2, y / step) * step, bottom = std::min(y + 2 * step, depth_.rows - 1);
    for (int x = box_.x; x < box_.br().x; ++x) {
      const float z = scratch_(y, x);
      if (z <= 0) continue;
      const float near = std::min(config_.same_surface_m, std::max(4 * sigma_(y, x), 0.03f));
      const float scale = 1 / near;
      const int left = x - std::min(2, x / step) * step, right = std::min(x + 2 * step, depth_.cols - 1);
      float sum = 0, weights = 0;
      for (int v = top; v <= bottom; v += step) {
        const float* row = scratch_.ptr<float>(v);
        for (int u = left; u <= right; u += step) {
          const float difference = (row[u] - z) * scale;
          const float root =
              std::max(1 - difference * difference, 0.0f);  // holes (0 m) are far from any surface
          const float weight = root * root;
          sum += weight * row[u];
          weights += weight;
        }
      }
      depth_(y, x) = sum / weights;
    }
  }
}

// He walks in or out where the depth camera does not look.
void ActorSurface::StandSomewhere(const BackgroundModel& model) {
  const float known = sum_.back()(0, 0), count = count_.back()(0, 0);
  if (count > 0) {
    last_m_ = known / count;
    return;
  }
  float z = last_m_;
  const int feet = box_.br().y - 1;
  if (z <= 0 && model.has_depth()) {
    const float* room = model.room_depth_m.ptr<float>(feet);
    int x = box_.x;
    while (x < box_.br().x - 1 && around_(feet, x) == 0) ++x;
    // Beside it, where the room is not known there: a floor is as far away at the same height.
    for (int step = 0; step < depth_.cols && z <= 0; ++step) {
      if (x - step >= 0) z = room[x - step];
      if (z <= 0 && x + step < depth_.cols) z = room[x + step];
    }
  }
  if (z > 0) depth_.setTo(z, around_);
}

// Two depth pictures, both where he is seen now: what lies between them is his step along the view. A block's
// median, drawn towards that of all of him: an arm is not his body, but a few pixels are only noise.
void ActorSurface::LearnSpeed(std::int64_t measured_us) {
  const cv::Size blocks((depth_.cols + kSpeedBlock - 1) / kSpeedBlock,
                        (depth_.rows + kSpeedBlock - 1) / kSpeedBlock);
  if (speed_.size() != blocks || !has_before_) {
    speed_.create(blocks);
    speed_.setTo(0);
  }
  const double between_s = static_cast<double>(measured_us - measured_us_) * 1e-6;
  if (has_before_ && before_.size() == depth_.size() && between_s > 0 && between_s < kLongestStep_s) {
    const auto median = [](std::vector<float>& values) {
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      return *middle;
    };
    const auto collect = [&](const cv::Rect& where, std::vector<float>* steps) {
      steps->clear();
      for (int y = where.y; y < where.br().y; ++y) {
        const float* now = depth_.ptr<float>(y);
        const float* then = before_.ptr<float>(y);
        for (int x = where.x; x < where.br().x; ++x) {
          const float step = now[x] - then[x];
          if (now[x] > 0 && then[x] > 0 && std::abs(step) < kFastest_m_s * static_cast<float>(between_s))
            steps->push_back(step);
        }
      }
    };
    collect(box_, &all_steps_);
    const float all = all_steps_.size() < kFewSteps ? 0.0f : median(all_steps_);
    const cv::Rect whole({0, 0}, depth_.size());
    for (int row = 0; row < blocks.height; ++row) {
      for (int column = 0; column < blocks.width; ++column) {
        const cv::Rect block(column * kSpeedBlock, row * kSpeedBlock, kSpeedBlock, kSpeedBlock);
        if ((block & box_).empty()) continue;
        collect(block & whole, &steps_);
        const auto count = static_cast<float>(steps_.size());
        const float own = steps_.empty() ? 0.0f : median(steps_);
        const float step = (count * own + kFewSteps * all) / (count + kFewSteps);
        float& speed = speed_(row, column);
        speed += 0.5f * (step / static_cast<float>(between_s) - speed);
      }
    }
  }
  depth_.copyTo(before_);
  measured_us_ = measured_us;
  has_before_ = true;
}

void ActorSurface::Advance(double age_s) {
  if (age_s <= 0 || age_s > kLongestStep_s) return;
  cv::resize(speed_, pace_, {speed_.cols * kSpeedBlock, speed_.rows * kSpeedBlock}, 0, 0, cv::INTER_LINEAR);
  const auto age = static_cast<float>(age_s);
  for (int y = box_.y; y < box_.br().y; ++y) {
    const float* pace = pace_.ptr<float>(y);
    float* z = depth_.ptr<float>(y);
    for (int x = box_.x; x < box_.br().x; ++x) {
      if (z[x] > 0) z[x] = std::max(z[x] + pace[x] * age, 0.05f);
    }
  }
}

void ActorSurface::BuildPyramid() {
  for (std::size_t i = 1; i < sum_.size(); ++i) {
    const cv::Mat1f& from_sum = sum_[i - 1];
    const cv::Mat1f& from_count = count_[i - 1];
    sum_[i].create(Half(from_sum.rows), Half(from_sum.cols));
    count_[i].create(sum_[i].size());
    for (int y = 0; y < sum_[i].rows; ++y) {
      const int top = 2 * y, bottom = std::min(2 * y + 1, from_sum.rows - 1);
      const float repeat = bottom == top ? 0.0f : 1.0f;
      for (int x = 0; x < sum_[i].cols; ++x) {
        const int left = 2 * x, right = std::min(2 * x + 1, from_sum.cols - 1);
        const float second = right == left ? 0.0f : 1.0f;
        const auto add = [&](const cv::Mat1f& m) {
          const float* a = m.ptr<float>(top);
          const float* b = m.ptr<float>(bottom);
          return a[left] + second * a[right] + repeat * (b[left] + second * b[right]);
        };
        sum_[i](y, x) = add(from_sum);
        count_[i](y, x) = add(from_count);
      }
    }
  }
}

// Mean of what is known around (x, y), at the finest level from `level` up that knows anything; 0 = nothing
// anywhere. A 3x3 window at each level: the nearest known depth may lie across a cell's border.
float ActorSurface::FromPyramid(int x, int y, std::size_t level) const {
  for (std::size_t i = level; i < sum_.size(); ++i) {
    const int cx = x >> i, cy = y >> i;
    float sum = 0, count = 0;
    for (int v = std::max(cy - 1, 0); v <= std::min(cy + 1, sum_[i].rows - 1); ++v) {
      for (int u = std::max(cx - 1, 0); u <= std::min(cx + 1, sum_[i].cols - 1); ++u) {
        sum += sum_[i](v, u);
        count += count_[i](v, u);
      }
    }
    if (count >= 1) return sum / count;
  }
  return 0;
}

void ActorSurface::FillHoles() {
  depth_.copyTo(sum_[0]);
  cv::threshold(depth_, count_[0], 0, 1, cv::THRESH_BINARY);
  BuildPyramid();
  for (int y = box_.y; y < box_.br().y; ++y) {
    for (int x = box_.x; x < box_.br().x; ++x) {
      if (depth_(y, x) <= 0 && around_(y, x) != 0) depth_(y, x) = FromPyramid(x, y, 1);
    }
  }
}

}  // namespace mixstage
