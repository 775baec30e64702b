// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/left_behind.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "proto/base/check.h"
#include "proto/base/median.h"
#include "server/segmentation/nearest_depth.h"

namespace mixstage {
namespace {

constexpr float kAlways = 0.9f;      // share of the frames in which a still thing is in the foreground
constexpr float kSteady = 3.0f;      // of the room's typical noise: what stands still trembles no more
constexpr int kBeside = 4;           // half-size pixels: a click may miss a thin thing by so much
constexpr int kRim = 3;              // half-size pixels around the thing that are taken over with it
constexpr std::size_t kFewest = 12;  // pixels
constexpr double kMostOfPicture = 0.6;
// A surface goes on where its depth steps by less than this, or this share of it.
constexpr float kStep_m = 0.1f, kStepShare = 0.04f;
constexpr float kOftenMeasured = 0.5f;  // share of depth pictures
constexpr float kLeastDepthSigma_m = 0.004f;
constexpr float kHidden = 0.97f;  // of the thing's distance: the room stands before it
constexpr int kTurns = 4;         // of the search for where a pixel's ray meets the thing

float MedianOf(const cv::Mat1f& plane) {
  std::vector<float> values;
  for (int y = 0; y < plane.rows; y += 2) {
    for (int x = 0; x < plane.cols; x += 2) values.push_back(plane(y, x));
  }
  return values.empty() ? 0.0f : Median(values);
}

tl::unexpected<Error> Refuse(const char* sentence) { return Fail(ErrorCode::kBadInput, sentence); }

// The still pixels that hang together with one at or near `at`.
std::vector<cv::Point> Grow(const cv::Mat1b& still, const cv::Mat1f& depth_m, cv::Point at) {
  std::optional<cv::Point> start;
  int best = 2 * kBeside * kBeside + 1;
  for (int dy = -kBeside; dy <= kBeside; ++dy) {
    for (int dx = -kBeside; dx <= kBeside; ++dx) {
      const cv::Point p(at.x + dx, at.y + dy);
      if (!cv::Rect({}, still.size()).contains(p) || still(p) == 0 || dx * dx + dy * dy >= best) continue;
      best = dx * dx + dy * dy;
      start = p;
    }
  }
  std::vector<cv::Point> found;
  if (!start) return found;
  cv::Mat1b open = still.clone();
  open(*start) = 0;
  found.push_back(*start);
  for (std::size_t i = 0; i < found.size(); ++i) {
    for (const cv::Point step : {cv::Point(1, 0), cv::Point(-1, 0), cv::Point(0, 1), cv::Point(0, -1)}) {
      const cv::Point next = found[i] + step;
      if (!cv::Rect({}, still.size()).contains(next) || open(next) == 0) continue;
      const float here = depth_m(found[i]), there = depth_m(next);
      if (here > 0 && there > 0 && std::abs(here - there) > std::max(kStep_m, kStepShare * here)) continue;
      open(next) = 0;
      found.push_back(next);
    }
  }
  return found;
}

}  // namespace

void LeftBehind::Look(double u, double v) {
  at_ = cv::Point(static_cast<int>(std::lround(std::clamp(u, -1e4, 1e4))) / 2,
                  static_cast<int>(std::lround(std::clamp(v, -1e4, 1e4))) / 2);
  frames_ = 0;
}

std::optional<Result<std::shared_ptr<const AdoptedThing>>> LeftBehind::See(const SeenFrame& frame,
                                                                           const BackgroundModel& room) {
  if (!at_) return std::nullopt;
  const cv::Size size = frame.half_mask->size();
  if (frames_ == 0) {
    T_world_color_ = frame.T_world_color;
    depth_frames_ = 0;
    for (cv::Mat1f* plane : {&in_front_, &sum_[0], &sum_[1], &sum_[2], &square_[0], &square_[1], &square_[2],
                             &depth_count_, &depth_sum_, &depth_square_}) {
      plane->create(size);
      plane->setTo(0);
    }
  }
  if (frame.T_world_color.matrix() != T_world_color_.matrix()) {
    at_.reset();
    return Refuse("The camera moved meanwhile: let it stand for a second.");
  }
  MIX_CHECK(in_front_.size() == size && frame.picture->r.size() == size);
  ++frames_;
  const std::array<const cv::Mat1b*, 3> now = {&frame.picture->r, &frame.picture->g, &frame.picture->b};
  for (int y = 0; y < size.height; ++y) {
    const std::uint8_t* mask = frame.half_mask->ptr<std::uint8_t>(y);
    float* in_front = in_front_.ptr<float>(y);
    for (int x = 0; x < size.width; ++x) in_front[x] += mask[x] != 0 ? 1.0f : 0.0f;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint8_t* from = now[c]->ptr<std::uint8_t>(y);
      float* sum = sum_[c].ptr<float>(y);
      float* square = square_[c].ptr<float>(y);
      const float scale = 1 / frame.tone.gain[c];
      for (int x = 0; x < size.width; ++x) {
        const float value = (from[x] - frame.tone.offset[c]) * scale;
        sum[x] += value;
        square[x] += value * value;
      }
    }
  }
  if (!frame.new_depth_m.empty()) {
    ++depth_frames_;
    for (int y = 0; y < size.height; ++y) {
      const float* from = frame.new_depth_m.row(std::min(2 * y, frame.new_depth_m.height() - 1));
      for (int x = 0; x < size.width; ++x) {
        const float z = from[std::min(2 * x, frame.new_depth_m.width() - 1)];
        if (!(z > 0 && z < 1e4f)) continue;
        depth_count_(y, x) += 1;
        depth_sum_(y, x) += z;
        depth_square_(y, x) += z * z;
      }
    }
  }
  if (frames_ < kFrames) return std::nullopt;
  auto thing = Decide(room);
  at_.reset();
  return thing;
}

Result<std::shared_ptr<const AdoptedThing>> LeftBehind::Decide(const BackgroundModel& room) const {
  const cv::Size size = in_front_.size();
  MIX_CHECK(room.mean[0].size() == size);
  const auto n = static_cast<float>(frames_);
  auto thing = std::make_shared<AdoptedThing>();
  cv::Mat1b steady(size, std::uint8_t{255});
  std::array<cv::Mat1f, 3> mean, spread;
  for (std::size_t c = 0; c < 3; ++c) {
    mean[c] = sum_[c] / n;
    spread[c] = cv::max(square_[c] / n - mean[c].mul(mean[c]), 0);
    const float most = kSteady * kSteady * std::max(MedianOf(room.variance[c]), 1.0f);
    cv::Mat1b trembles;
    cv::compare(spread[c], most, trembles, cv::CMP_GT);
    steady.setTo(0, trembles);
  }
  cv::Mat1f depth_m(size, 0.0f);
  std::vector<float> depth_spreads;
  for (int y = 0; y < size.height && depth_frames_ > 0; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const float count = depth_count_(y, x);
      if (count < kOftenMeasured * static_cast<float>(depth_frames_)) continue;
      depth_m(y, x) = depth_sum_(y, x) / count;
    }
  }
  cv::Mat1b always, still;
  cv::compare(in_front_, kAlways * n, always, cv::CMP_GE);
  cv::bitwise_and(always, steady, still);
  const std::vector<cv::Point> pixels = Grow(still, depth_m, *at_);
  if (pixels.size() < kFewest)
    return Refuse("Nothing stands still there in the foreground: wait until it does, or point at it.");
  if (static_cast<double>(pixels.size()) > kMostOfPicture * static_cast<double>(still.total()))
    return Refuse("What stands there fills the picture: that is no thing left behind.");

  // With its rim, where the key's outline may tremble: what is measured there is right, thing or room.
  cv::Mat1b mask(size, std::uint8_t{0});
  for (const cv::Point& p : pixels) mask(p) = 255;
  cv::dilate(mask, mask, cv::getStructuringElement(cv::MORPH_RECT, {2 * kRim + 1, 2 * kRim + 1}));
  cv::bitwise_and(mask, steady, mask);
  thing->T_world_color = T_world_color_;
  thing->box = cv::boundingRect(mask);
  thing->mask = mask(thing->box).clone();
  for (std::size_t c = 0; c < 3; ++c) {
    thing->mean[c] = mean[c](thing->box).clone();
    thing->spread[c] = spread[c](thing->box).clone();
  }
  // Depth belongs to what was in the foreground; its rim is the room's.
  cv::Mat1b own(size, std::uint8_t{0});
  for (const cv::Point& p : pixels) own(p) = 255;
  cv::Mat1b ever;
  cv::compare(in_front_, 0, ever, cv::CMP_GT);
  cv::bitwise_and(mask, ever, ever);
  cv::bitwise_or(own, ever, own);
  for (const cv::Point& p : pixels) {
    const float count = depth_count_(p);
    if (depth_m(p) > 0 && count > 1)
      depth_spreads.push_back(std::max(depth_square_(p) / count - depth_m(p) * depth_m(p), 0.0f));
  }
  depth_m.setTo(0, own == 0);
  thing->depth_m = depth_m(thing->box).clone();
  cv::Mat1f nearest_m, distance_px;
  if (!depth_spreads.empty() && FindNearestDepth(thing->depth_m, &nearest_m, &distance_px))
    nearest_m.copyTo(thing->depth_m, own(thing->box));
  thing->depth_sigma_m =
      std::max(kLeastDepthSigma_m, depth_spreads.empty() ? 0.0f : std::sqrt(Median(depth_spreads)));
  return std::shared_ptr<const AdoptedThing>(std::move(thing));
}

void LayThing(const AdoptedThing& thing, BackgroundModel* model) {
  MIX_CHECK(model != nullptr && (cv::Rect({}, model->mean[0].size()) & thing.box) == thing.box);
  for (std::size_t c = 0; c < 3; ++c) {
    const float typical = MedianOf(model->variance[c]);
    // Others hold the planes of the model that this one was copied from.
    model->mean[c] = model->mean[c].clone();
    model->variance[c] = model->variance[c].clone();
    for (int y = 0; y < thing.box.height; ++y) {
      for (int x = 0; x < thing.box.width; ++x) {
        if (thing.mask(y, x) == 0) continue;
        const cv::Point at(thing.box.x + x, thing.box.y + y);
        model->mean[c](at) = thing.mean[c](y, x);
        model->variance[c](at) = std::max(typical, thing.spread[c](y, x));
      }
    }
  }
  if (!model->seen.empty()) {
    model->seen = model->seen.clone();
    cv::Mat part = model->seen(thing.box);
    part.setTo(RoomPrediction::kSeen, thing.mask);
  }
  model->log_peak_room.release();
  model->log_peak_shadow.release();
  model->mean_luma.release();
  model->texture_noise.release();
  FinishColor(model);
  if (!model->has_depth()) return;
  model->room_depth_m = model->room_depth_m.clone();
  model->sigma_m = model->sigma_m.clone();
  const cv::Mat1f weight_before = model->depth_weight;
  cv::Mat1b laid(model->room_depth_m.size(), std::uint8_t{0});
  for (int y = 0; y < laid.rows; ++y) {
    for (int x = 0; x < laid.cols; ++x) {
      // Where QuarterDepth takes its samples.
      const cv::Point at(std::min(4 * x + 1, model->width - 1) / 2 - thing.box.x,
                         std::min(4 * y + 1, model->height - 1) / 2 - thing.box.y);
      if (!cv::Rect({}, thing.box.size()).contains(at) || !(thing.depth_m(at) > 0)) continue;
      model->room_depth_m(y, x) = thing.depth_m(at);
      model->sigma_m(y, x) = std::max(thing.depth_sigma_m, kLeastDepthSigma_m);
      laid(y, x) = 255;
    }
  }
  model->depth_weight.release();
  model->log_peak_depth.release();
  FinishDepth(cv::Mat1f(laid.size(), 1.0f), model);
  // Elsewhere: how often the room itself is measured, and the thing's edges.
  for (int y = 0; y < laid.rows; ++y) {
    for (int x = 0; x < laid.cols; ++x) {
      if (laid(y, x) == 0)
        model->depth_weight(y, x) = std::min(model->depth_weight(y, x), weight_before(y, x));
    }
  }
}

void LayThing(const AdoptedThing& thing, const PinholeCamera& camera, const cv::Mat2f& rays,
              const RigidTransform& T_world_color, RoomPrediction* room) {
  MIX_CHECK(room != nullptr && room->depth_m.size() == rays.size());
  MIX_CHECK(camera.width == rays.cols && camera.height == rays.rows);
  const RigidTransform T_then_now = thing.T_world_color.inverse() * T_world_color;
  const RigidTransform T_now_then = T_then_now.inverse();
  const bool same = thing.T_world_color.matrix() == T_world_color.matrix();
  const cv::Size half = room->r.size();
  auto full = [&](cv::Point p) {
    return cv::Point(std::min(2 * p.x, camera.width - 1), std::min(2 * p.y, camera.height - 1));
  };
  // Where the thing lies now, and how far away it is on the whole.
  std::vector<float> depths;
  cv::Rect now = thing.box;
  if (!same) {
    cv::Point low(half), high(-1, -1);
    for (int y = 0; y < thing.box.height; ++y) {
      for (int x = 0; x < thing.box.width; ++x) {
        const float z = thing.depth_m(y, x);
        if (thing.mask(y, x) == 0 || !(z > 0)) continue;
        const cv::Vec2f ray = rays(full({thing.box.x + x, thing.box.y + y}));
        const Eigen::Vector3d p = T_now_then * Eigen::Vector3d(z * ray[0], z * ray[1], z);
        depths.push_back(static_cast<float>(p.z()));
        const auto pixel = camera.Project(p);
        if (!pixel || !(pixel->array().abs() < 1e5).all()) continue;
        const cv::Point at(static_cast<int>(pixel->x() / 2), static_cast<int>(pixel->y() / 2));
        low = {std::min(low.x, at.x), std::min(low.y, at.y)};
        high = {std::max(high.x, at.x), std::max(high.y, at.y)};
      }
    }
    // Without any depth nothing says where it went.
    if (depths.empty()) return;
    const cv::Point rim(kRim + 1, kRim + 1);
    now = cv::Rect(low - rim, high + rim + cv::Point(1, 1)) & cv::Rect({}, half);
  }
  const float typical_m = depths.empty() ? 0.0f : Median(depths);
  for (int y = now.y; y < now.br().y; ++y) {
    for (int x = now.x; x < now.br().x; ++x) {
      cv::Point from(x - thing.box.x, y - thing.box.y);
      float z_now = 0;
      if (!same) {
        const cv::Vec2f ray = rays(full({x, y}));
        if (!(ray[0] == ray[0]) || typical_m <= 0) continue;
        // The ray's point at the distance that the thing has where the point falls in its own picture.
        z_now = typical_m;
        for (int turn = 0; turn < kTurns; ++turn) {
          const Eigen::Vector3d p = T_then_now * Eigen::Vector3d(z_now * ray[0], z_now * ray[1], z_now);
          const auto pixel = camera.Project(p);
          from = {-1, -1};
          if (!pixel || !(pixel->array().abs() < 1e5).all()) break;
          from = cv::Point(static_cast<int>(std::lround(pixel->x() / 2)) - thing.box.x,
                           static_cast<int>(std::lround(pixel->y() / 2)) - thing.box.y);
          if (!cv::Rect({}, thing.box.size()).contains(from)) break;
          const float z = thing.depth_m(from);
          if (z > 0) z_now += z - static_cast<float>(p.z());
        }
      }
      if (!cv::Rect({}, thing.box.size()).contains(from) || thing.mask(from) == 0) continue;
      const float z = same ? thing.depth_m(from) : (thing.depth_m(from) > 0 ? z_now : 0.0f);
      const float behind = room->depth_m(full({x, y}));
      if (!same && z > 0 && behind > 0 && behind < kHidden * z) continue;
      room->r(y, x) = cv::saturate_cast<std::uint8_t>(thing.mean[0](from));
      room->g(y, x) = cv::saturate_cast<std::uint8_t>(thing.mean[1](from));
      room->b(y, x) = cv::saturate_cast<std::uint8_t>(thing.mean[2](from));
      room->seen(y, x) = RoomPrediction::kSeen;
      if (!(z > 0)) continue;
      for (int v = 2 * y; v < std::min(2 * y + 2, camera.height); ++v) {
        for (int u = 2 * x; u < std::min(2 * x + 2, camera.width); ++u) room->depth_m(v, u) = z;
      }
    }
  }
}

}  // namespace mixstage
