// SPDX-License-Identifier: Apache-2.0
#include "server/app/learn_take.h"

#include <algorithm>
#include <array>
#include <utility>

#include "server/ingest/take_ingest.h"

namespace mixstage {
namespace {

constexpr int kSpreadSamples = 40;
constexpr int kFewestStillFrames = 5;

// Feeds pictures of a take to an estimator. A depth picture goes in once, with the first colour picture it
// belongs to.
class Feeder {
 public:
  Feeder(const Take& take, Studio& studio, std::vector<std::string>& warnings)
      : ingest_(take, studio.rig()), studio_(studio), warnings_(warnings) {}

  void Feed(int index, BackgroundEstimator& estimator) {
    std::string warning;
    auto captured = ingest_.Load(index, warning);
    if (!captured) warning = captured.error().message;
    if (!warning.empty()) warnings_.push_back(warning);
    if (!captured) return;
    HalfRgb((*captured)->color, &half_);
    const bool new_depth = (*captured)->depth != nullptr && (*captured)->depth != last_depth_;
    last_depth_ = (*captured)->depth;
    const cv::Mat1f D = new_depth ? studio_.WarpDepth(**captured) : cv::Mat1f();
    estimator.Add(half_, View(D));
  }
  [[nodiscard]] int frames() const { return ingest_.frames(); }

 private:
  TakeIngest ingest_;
  Studio& studio_;
  std::vector<std::string>& warnings_;
  HalfPicture half_;
  std::shared_ptr<const DepthPicture> last_depth_;
};

Result<LearntRoom> Learnt(Result<BackgroundModel> model, RoomState state, std::string how) {
  if (!model) return tl::unexpected(model.error());
  return LearntRoom{std::make_shared<const BackgroundModel>(std::move(*model)), state, std::move(how)};
}

}  // namespace

Result<LearntRoom> LearnFromCleanPlate(const Take& plate, Studio& studio,
                                       std::vector<std::string>& warnings) {
  auto estimator = BackgroundEstimator::Create({}, studio.rig().color.width, studio.rig().color.height);
  if (!estimator) return tl::unexpected(estimator.error());
  Feeder feeder(plate, studio, warnings);
  for (int i = 0; i < feeder.frames(); ++i) feeder.Feed(i, *estimator);
  if (estimator->size() == 0) {
    return Fail(ErrorCode::kBadInput, plate.folder.string() + ": no picture of the clean plate can be used");
  }
  const std::string frames = std::to_string(estimator->size()) + " frames";
  // A plate that was not quite empty (somebody passed, a car on the road) still shows the set most of the
  // time.
  if (!estimator->IsStill()) {
    warnings.push_back(
        plate.folder.string() +
        ": the clean plate does not stand still; what it shows most is taken as the empty set");
    if (auto robust = estimator->EstimateRobust()) {
      return Learnt(std::move(robust), RoomState::kKnown, "clean plate that is not still, " + frames);
    }
  }
  return Learnt(estimator->EstimateEmpty(), RoomState::kKnown, "clean plate, " + frames);
}

Result<LearntRoom> LearnFromTake(const Take& take, int learn_frames, Studio& studio,
                                 std::vector<std::string>& warnings) {
  const int width = studio.rig().color.width;
  const int height = studio.rig().color.height;
  Feeder feeder(take, studio, warnings);
  auto spread = BackgroundEstimator::Create({.max_samples = kSpreadSamples}, width, height);
  if (!spread) return tl::unexpected(spread.error());
  const int samples = std::min(kSpreadSamples, feeder.frames());
  for (int i = 0; i < samples; ++i) {
    feeder.Feed(static_cast<int>(std::int64_t{i} * feeder.frames() / samples), *spread);
  }
  auto robust = spread->EstimateRobust();
  if (!robust) {
    // Too few frames for statistics over time: what there is must serve as the empty set.
    warnings.push_back(
        "the take is too short to learn the empty set from: its first frame is taken as empty");
    auto first = BackgroundEstimator::Create({}, width, height);
    if (!first) return tl::unexpected(first.error());
    feeder.Feed(0, *first);
    return Learnt(first->EstimateEmpty(), RoomState::kEstimated, "first frame");
  }
  // The longest still beginning, L frames at most.
  for (const int length : std::array{learn_frames, learn_frames * 2 / 3, learn_frames / 2, learn_frames / 3,
                                     kFewestStillFrames}) {
    if (length < kFewestStillFrames || length > feeder.frames()) continue;
    auto first = BackgroundEstimator::Create({.max_samples = length}, width, height);
    if (!first) return tl::unexpected(first.error());
    for (int i = 0; i < length; ++i) feeder.Feed(i, *first);
    if (first->IsStill() && first->Agrees(*robust)) {
      return Learnt(first->EstimateEmpty(), RoomState::kKnown,
                    "first " + std::to_string(length) + " frames, empty");
    }
  }
  return Learnt(std::move(robust), RoomState::kEstimated,
                "robust estimate over " + std::to_string(samples) + " frames of the take");
}

}  // namespace mixstage
