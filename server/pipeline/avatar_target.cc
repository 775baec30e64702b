// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/avatar_target.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "proto/base/log.h"
#include "server/depth/floor_pose.h"
#include "server/segmentation/actor_stance.h"
#include "server/segmentation/nearest_depth.h"

namespace mixstage {
namespace {

constexpr float kWidestHole = 16;  // half-size pixels to its border
constexpr int kFloorFrames = 5;    // in which a video's floor is looked for
constexpr int kFloorSpacing = 10;  // frames between them
// What a depth camera says of the video's room, with what it leaves out at edges.
constexpr float kLeastSigma_m = 0.005f, kVideoSigma = 0.01f;  // and share of z

// Where known is 0 the picture goes on from around: coarser and coarser means of what is known.
void FillUnknown(const cv::Mat1b& known, cv::Mat3b& picture) {
  if (cv::countNonZero(known) == static_cast<int>(known.total())) return;
  struct Level {
    cv::Mat3f sum;
    cv::Mat1f share;
  };
  std::vector<Level> levels(1);
  known.convertTo(levels[0].share, CV_32F, 1.0 / 255);
  picture.convertTo(levels[0].sum, CV_32F);
  for (int y = 0; y < known.rows; ++y) {
    for (int x = 0; x < known.cols; ++x) {
      if (known(y, x) == 0) levels[0].sum(y, x) = cv::Vec3f::all(0);
    }
  }
  while (std::max(levels.back().share.rows, levels.back().share.cols) > 1) {
    const cv::Size half((levels.back().share.cols + 1) / 2, (levels.back().share.rows + 1) / 2);
    Level next;
    cv::resize(levels.back().sum, next.sum, half, 0, 0, cv::INTER_AREA);
    cv::resize(levels.back().share, next.share, half, 0, 0, cv::INTER_AREA);
    levels.push_back(std::move(next));
  }
  cv::Mat3f filled;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    cv::Mat3f coarser;
    if (filled.empty()) {
      coarser = cv::Mat3f(level->sum.size(), cv::Vec3f::all(0));
    } else {
      cv::resize(filled, coarser, level->sum.size(), 0, 0, cv::INTER_LINEAR);
    }
    for (int y = 0; y < coarser.rows; ++y) {
      for (int x = 0; x < coarser.cols; ++x) {
        const float share = level->share(y, x);
        coarser(y, x) = level->sum(y, x) + (1 - share) * coarser(y, x);
      }
    }
    filled = coarser;
  }
  for (int y = 0; y < known.rows; ++y) {
    for (int x = 0; x < known.cols; ++x) {
      if (known(y, x) != 0) continue;
      for (int c = 0; c < 3; ++c) picture(y, x)[c] = cv::saturate_cast<std::uint8_t>(filled(y, x)[c]);
    }
  }
}

// Holes no wider than they come from a silhouette or dark hair.
void FillHoles(cv::Mat1f& depth_m) {
  const cv::Size half((depth_m.cols + 1) / 2, (depth_m.rows + 1) / 2);
  cv::Mat1f small, nearest_m, distance_px;
  cv::resize(depth_m, small, half, 0, 0, cv::INTER_NEAREST);
  if (!FindNearestDepth(small, &nearest_m, &distance_px)) return;
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) {
      if (depth_m(y, x) == 0 && distance_px(y / 2, x / 2) <= kWidestHole)
        depth_m(y, x) = nearest_m(y / 2, x / 2);
    }
  }
}

// What edits need to know of a room: its depth; and viewers, its picture.
std::shared_ptr<const BackgroundModel> ModelOf(const RoomPrediction& room, float sigma_m) {
  auto model = std::make_shared<BackgroundModel>();
  model->width = room.width;
  model->height = room.height;
  for (const auto& [from, to] : {std::pair(&room.r, &model->mean[0]), std::pair(&room.g, &model->mean[1]),
                                 std::pair(&room.b, &model->mean[2])})
    from->convertTo(*to, CV_32F);
  QuarterDepth(View(room.depth_m), &model->room_depth_m);
  model->sigma_m = cv::Mat1f(model->room_depth_m.size(), sigma_m);
  return model;
}

}  // namespace

cv::Mat3b WholePicture(RoomView& view, const RoomPrediction& prediction) {
  cv::Mat3b picture = view.Picture();
  cv::Mat1b known(picture.size());
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      cv::Vec3b& p = picture(y, x);
      known(y, x) = 255;
      if (p != cv::Vec3b::all(0)) continue;
      const cv::Point half(x / 2, y / 2);
      p = {prediction.b(half), prediction.g(half), prediction.r(half)};
      known(y, x) = prediction.seen(half) != 0 ? 255 : 0;
    }
  }
  FillUnknown(known, picture);
  return picture;
}

AvatarTarget::Seen RoomTarget::See(std::int64_t, const RigidTransform& T_world_color, ChromaLayout layout) {
  const RigidTransform& pose = pose_ ? *pose_ : T_world_color;
  const RoomPrediction& prediction = view_.Look(pose);
  const float sigma_m = std::max(depth_sigma_m_, 1e-3f);
  if (drawing_ != prediction.drawing || picture_.layout != layout) {
    drawing_ = prediction.drawing;
    picture_ = FromBgr(WholePicture(view_, prediction), layout);
    depth_.revision = drawing_;
    depth_.depth_m = prediction.depth_m;
    if (depth_.sigma_m.size() != prediction.depth_m.size())
      depth_.sigma_m = cv::Mat1f(prediction.depth_m.size(), sigma_m);
    room_.reset();
  } else if (!room_) {  // it stands
    room_ = ModelOf(prediction, sigma_m);
  }
  return {pose, &picture_, &depth_, room_};
}

Result<std::unique_ptr<VideoTarget>> VideoTarget::Create(AvatarVideo video, const RenderDevice& device) {
  const std::string name = video.take.folder.string();
  if (!video.rig.depth || video.take.depth.empty())
    return Fail(ErrorCode::kBadInput,
                name + ": has no depth (depth.txt): an avatar needs a video with depth");
  auto warp = DepthWarp::Create(video.rig, {}, device);
  if (!warp) return Within(name + ": rig", warp.error());
  std::unique_ptr<VideoTarget> target(new VideoTarget(std::move(video), std::move(*warp)));
  const bool placed = !target->video_.poses.empty() || target->video_.rig.ptu;
  const int frames = target->ingest_.frames();
  std::optional<FloorSeen> floor;
  for (int i = 0; !placed && !floor && i < kFloorFrames && i * kFloorSpacing < frames; ++i) {
    if (auto ok = target->Show(i * kFloorSpacing); !ok) return tl::unexpected(ok.error());
    floor = FindFloorBelow(View(std::as_const(target->depth_.depth_m)), target->video_.rig.color);
  }
  if (auto ok = target->Show(0); !ok) return tl::unexpected(ok.error());
  if (!placed && !floor) {
    return Fail(
        ErrorCode::kBadInput,
        name + ": its depth shows no floor and nothing else says where its camera stands: give poses");
  }
  if (floor) {
    target->standing_ = PoseOver(floor->up, floor->height_m);
    spdlog::info("avatar video={} camera=\"{:.2f} m over the floor\"", name, floor->height_m);
  }
  return target;
}

RigidTransform VideoTarget::PoseOf(const CapturedFrame& frame) const {
  if (!video_.poses.empty()) {
    const auto nearest =
        std::min_element(video_.poses.begin(), video_.poses.end(), [&](const auto& a, const auto& b) {
          return std::abs(a.t_s - frame.take_t_s) < std::abs(b.t_s - frame.take_t_s);
        });
    return nearest->T_world_color;
  }
  if (standing_) return *standing_;
  const HeadAngles head = frame.head.value_or(HeadAngles{});
  return video_.rig.ptu->TWorldColor(head.pan_deg, head.tilt_deg);
}

Status VideoTarget::Show(int index) {
  if (index == shown_) return {};
  std::string warning;
  auto frame = ingest_.Load(index, warning);
  if (!frame) return tl::unexpected(frame.error());
  frame_ = std::move(*frame);
  shown_ = index;
  const cv::Size size(video_.rig.color.width, video_.rig.color.height);
  if (depth_.depth_m.size() != size) {
    depth_.depth_m = cv::Mat1f::zeros(size);
    depth_.sigma_m = cv::Mat1f(size, kLeastSigma_m);
    ++depth_.revision;
  }
  if (frame_->depth != nullptr && frame_->depth != warped_) {
    warped_ = frame_->depth;
    if (!warp_.Run(View(warped_->counts), View(warped_->amplitude), View(depth_.depth_m)))
      depth_.depth_m.setTo(0);
    FillHoles(depth_.depth_m);
    for (int y = 0; y < size.height; ++y) {
      const float* z = depth_.depth_m[y];
      float* sigma = depth_.sigma_m[y];
      for (int x = 0; x < size.width; ++x) sigma[x] = kLeastSigma_m + kVideoSigma * z[x];
    }
    ++depth_.revision;
  }
  return {};
}

AvatarTarget::Seen VideoTarget::See(std::int64_t t_us, const RigidTransform&, ChromaLayout) {
  const std::vector<TakeEntry>& color = video_.take.color;
  const double first_s = color.front().t_s;
  // The last picture stays as long as the others do.
  const auto gaps = static_cast<double>(std::max<std::size_t>(1, color.size() - 1));
  const double length_s = std::max(1e-3, (color.back().t_s - first_s) * (gaps + 1) / gaps);
  const double t_s = first_s + std::fmod(static_cast<double>(t_us) * 1e-6, length_s);
  const auto after = std::upper_bound(color.begin(), color.end(), t_s + 1e-6,
                                      [](double t, const TakeEntry& entry) { return t < entry.t_s; });
  // One that cannot be read leaves the one before standing.
  (void)Show(static_cast<int>(std::max<std::ptrdiff_t>(0, after - color.begin() - 1)));
  return {PoseOf(*frame_), &frame_->color, &depth_, nullptr};
}

}  // namespace mixstage
