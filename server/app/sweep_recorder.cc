// SPDX-License-Identifier: Apache-2.0
#include "server/app/sweep_recorder.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr std::int64_t kRestUs = 200'000;        // so long the head has to stay
constexpr double kRest_deg = 0.05;               // within so much: several times an encoder's noise
constexpr double kReached_deg = 0.3;             // of the goal: a head stops at its next step
constexpr std::int64_t kNoAgentUs = 30'000'000;  // an agent that was started together with the scan
constexpr std::int64_t kSilenceUs = 10'000'000;
constexpr std::int64_t kAgentGoneUs = 2'000'000;
constexpr std::int64_t kSendAgainUs = 3'000'000;  // a command may be lost three times
constexpr std::int64_t kNotMovingUs = 8'000'000;  // a head that has not stirred by then does not go there
constexpr std::int64_t kPositionUs = 60'000'000;  // a slow head's longest way, and its pictures
constexpr std::int64_t kTakeGapUs = 10'000'000;   // between positions, on the take's clock
constexpr std::size_t kMaxReadings = 1'000, kMaxAmplitudes = 16;

std::string Text(const HeadPosition& at) {
  char text[64];
  std::snprintf(text, sizeof text, "pan %.1f tilt %.1f", at.pan_deg, at.tilt_deg);
  return text;
}

bool Near(const HeadPosition& a, const HeadPosition& b, double within_deg) {
  return std::abs(a.pan_deg - b.pan_deg) <= within_deg && std::abs(a.tilt_deg - b.tilt_deg) <= within_deg;
}

}  // namespace

SweepRecorder::SweepRecorder(const Rig& rig, std::vector<HeadPosition> positions, TakeWriter writer)
    : rig_(rig), positions_(std::move(positions)), writer_(std::move(writer)) {
  MIX_CHECK(rig_.depth.has_value() && !positions_.empty());
  LayOut();
}

// A map of the positions where they are a grid that a message can hold.
void SweepRecorder::LayOut() {
  std::vector<double> pans, tilts;
  for (const HeadPosition& at : positions_) {
    pans.push_back(at.pan_deg);
    tilts.push_back(at.tilt_deg);
  }
  for (std::vector<double>* angles : {&pans, &tilts}) {
    std::sort(angles->rbegin(), angles->rend());  // positive pan is left, positive tilt is up
    angles->erase(std::unique(angles->begin(), angles->end()), angles->end());
  }
  if (pans.size() * tilts.size() != positions_.size() || positions_.size() > kMaxSweepCells) return;
  map_.columns = static_cast<int>(pans.size());
  map_.rows = static_cast<int>(tilts.size());
  map_.pan_deg = {static_cast<float>(pans.front()), static_cast<float>(pans.back())};
  map_.tilt_deg = {static_cast<float>(tilts.front()), static_cast<float>(tilts.back())};
  map_.cells.assign(positions_.size(), SweepCell::kToCome);
  const auto place = [](const std::vector<double>& angles, double angle) {
    return static_cast<std::size_t>(std::find(angles.begin(), angles.end(), angle) - angles.begin());
  };
  for (const HeadPosition& at : positions_)
    cells_.push_back(place(tilts, at.tilt_deg) * pans.size() + place(pans, at.pan_deg));
}

void SweepRecorder::Mark(SweepCell cell) {
  if (!cells_.empty()) map_.cells[cells_[position_]] = cell;
}

ScanProgress SweepRecorder::Progress() const {
  ScanProgress progress{.positions = static_cast<int>(positions_.size()),
                        .recorded = recorded_,
                        .left_out = left_out_,
                        .map = map_,
                        .notes = notes_};
  if (!cells_.empty() && !done_ && epoch_ != 0) progress.map.cells[cells_[position_]] = SweepCell::kHead;
  return progress;
}

void SweepRecorder::Follow(std::int64_t epoch) {
  epoch_ = epoch;
  amplitude_known_ = false;
  StartPosition();
}

void SweepRecorder::StartPosition() {
  sent_us_ = first_sent_us_ = 0;
  sent_from_.reset();
  readings_.clear();
  ForgetPictures();
}

void SweepRecorder::ForgetPictures() {
  rests_since_us_.reset();
  rest_sum_ = {};
  rest_count_ = 0;
  color_.reset();
  depths_.clear();
  amplitudes_.clear();
}

void SweepRecorder::OnHead(const mixstage_lcm::head_angles_t& a, std::int64_t now_us) {
  if (a.epoch == 0 || !IsCountable(a.t_us) || !std::isfinite(a.pan_deg) || !std::isfinite(a.tilt_deg)) return;
  if (a.epoch != epoch_) {
    if (epoch_ != 0 && now_us - heard_us_ < kAgentGoneUs) return;
    if (epoch_ != 0) news_.push_back("the agent has started again");
    Follow(a.epoch);
  }
  if (!readings_.empty() && a.t_us <= readings_.back().t_us) return;
  heard_us_ = now_us;
  const HeadPosition at{a.pan_deg, a.tilt_deg};
  if (!home_) home_ = at;
  readings_.push_back({a.t_us, at});
  while (readings_.size() > kMaxReadings || a.t_us - readings_.front().t_us > kRestUs) readings_.pop_front();
  if (sent_us_ != 0) NoteRest();
}

void SweepRecorder::NoteRest() {
  const Reading& newest = readings_.back();
  if (rests_since_us_) {
    const HeadPosition mean{rest_sum_.pan_deg / rest_count_, rest_sum_.tilt_deg / rest_count_};
    if (!Near(newest.at, mean, kRest_deg)) return ForgetPictures();  // pushed, or sent on by somebody else
    rest_sum_.pan_deg += newest.at.pan_deg;
    rest_sum_.tilt_deg += newest.at.tilt_deg;
    ++rest_count_;
    return;
  }
  if (readings_.size() < 4 || newest.t_us - readings_.front().t_us < kRestUs * 3 / 4) return;
  HeadPosition sum;
  for (const Reading& r : readings_) {
    if (!Near(r.at, newest.at, kRest_deg)) return;
    sum.pan_deg += r.at.pan_deg;
    sum.tilt_deg += r.at.tilt_deg;
  }
  const auto count = static_cast<int>(readings_.size());
  if (!Near({sum.pan_deg / count, sum.tilt_deg / count}, positions_[position_], kReached_deg)) return;
  rest_sum_ = sum;
  rest_count_ = count;
  rests_since_us_ = readings_.front().t_us;
}

void SweepRecorder::OnPicture(const EncodedFrame& picture, std::int64_t) {
  if (done_ || picture.epoch != epoch_ || !rests_since_us_) return;
  if (picture.stream == Stream::kColor) {
    if (color_ || picture.t_us < *rests_since_us_) return;
    const auto header = jpeg_.ReadHeader(picture.bytes);
    if (!header || header->width != rig_.color.width || header->height != rig_.color.height) {
      ++other_sizes_;
      return;
    }
    color_ = Color{picture.t_us, picture.bytes};
    return;
  }
  if (picture.stream != Stream::kDepth && picture.stream != Stream::kAmplitude) return;
  if (picture.t_us + std::llround(rig_.depth_time_offset_s * 1e6) < *rests_since_us_) return;
  const PinholeCamera& camera = rig_.registered ? rig_.color : rig_.depth->camera;
  cv::Mat1w counts;
  if (!depth_decoder_.Decode(picture.bytes, counts) || counts.cols != camera.width ||
      counts.rows != camera.height) {
    ++other_sizes_;
    return;
  }
  if (picture.stream == Stream::kAmplitude) {
    amplitude_known_ = true;
    if (amplitudes_.size() < kMaxAmplitudes) amplitudes_[picture.t_us] = counts;
  } else if (depths_.size() < kDepths && (depths_.empty() || picture.t_us > depths_.back().t_us)) {
    depths_.push_back({picture.t_us, counts});
  } else if (depths_.size() == kDepths && !amplitudes_.contains(depths_.front().t_us)) {
    depths_.pop_front();  // its amplitude got lost
    depths_.push_back({picture.t_us, counts});
  }
}

bool SweepRecorder::HaveAll() const {
  if (!color_ || depths_.size() < kDepths) return false;
  return !amplitude_known_ || std::all_of(depths_.begin(), depths_.end(),
                                          [&](const Depth& d) { return amplitudes_.contains(d.t_us); });
}

Status SweepRecorder::WritePosition() {
  // Times within a position are the agent's; the head's way to the next counts for a second, whatever it
  // took.
  const std::int64_t begin_us = take_us_ + kTakeGapUs;
  auto time = [&](std::int64_t t_us) { return begin_us + (t_us - *rests_since_us_); };
  auto write = [&](TakeList list, std::int64_t t_us, const TakeContent& content) -> Status {
    auto written = writer_.WritePicture(list, time(t_us), content);
    if (!written) return tl::unexpected(written.error());
    take_us_ = std::max(take_us_, time(t_us));
    return {};
  };
  if (auto ok = write(TakeList::kColor, color_->t_us, color_->jpeg); !ok) return ok;
  for (const Depth& depth : depths_) {
    if (auto ok = write(TakeList::kDepth, depth.t_us, depth.range); !ok) return ok;
    const auto amplitude = amplitudes_.find(depth.t_us);
    if (amplitude == amplitudes_.end()) continue;
    if (auto ok = write(TakeList::kAmplitude, depth.t_us, amplitude->second); !ok) return ok;
  }
  // The mean of all readings at rest: an encoder's noise goes with their number.
  auto head = writer_.WriteHead(time(color_->t_us), rest_sum_.pan_deg / rest_count_,
                                rest_sum_.tilt_deg / rest_count_);
  if (!head) return tl::unexpected(head.error());
  ++recorded_;
  Mark(SweepCell::kRecorded);
  news_.push_back("position " + std::to_string(position_ + 1) + " of " + std::to_string(positions_.size()) +
                  ": " + Text(positions_[position_]));
  return {};
}

void SweepRecorder::LeaveOut(const std::string& reason) {
  news_.push_back("position " + std::to_string(position_ + 1) + " of " + std::to_string(positions_.size()) +
                  " is left out: " + Text(positions_[position_]) + ": " + reason);
  ++left_out_;
  Mark(SweepCell::kLeftOut);
  notes_ += Text(positions_[position_]) + ": " + reason + "\n";
}

AgentCommand SweepRecorder::Move(const HeadPosition& to) const {
  return {.verb = AgentVerb::kMoveHead, .pan_deg = to.pan_deg, .tilt_deg = to.tilt_deg};
}

Result<std::optional<AgentCommand>> SweepRecorder::NextPosition(std::int64_t now_us) {
  ++position_;
  const std::optional<Reading> last = readings_.empty() ? std::nullopt : std::optional(readings_.back());
  StartPosition();
  if (last) readings_.push_back(*last);
  if (position_ < positions_.size()) return Poll(now_us);
  done_ = true;
  if (auto ok = writer_.Sync(); !ok) return tl::unexpected(ok.error());
  if (recorded_ < 2 && recorded_ < static_cast<int>(positions_.size())) {
    return Fail(ErrorCode::kBadInput, "of " + std::to_string(positions_.size()) + " positions " +
                                          std::to_string(recorded_) +
                                          " could be recorded: a scan needs at least two");
  }
  return Move(*home_);
}

Result<std::optional<AgentCommand>> SweepRecorder::Poll(std::int64_t now_us) {
  if (done_) return std::nullopt;
  if (begun_us_ == 0) begun_us_ = heard_us_ = now_us;
  if (now_us - heard_us_ > (epoch_ == 0 ? kNoAgentUs : kSilenceUs)) {
    return Fail(ErrorCode::kUnavailable,
                epoch_ == 0
                    ? "no agent tells the angles of its head: is one running on this LCM URL, with a head "
                      "that can be moved?"
                    : "the agent has fallen silent");
  }
  if (epoch_ == 0) return std::nullopt;
  if (HaveAll()) {
    if (auto ok = WritePosition(); !ok) return tl::unexpected(ok.error());
    return NextPosition(now_us);
  }
  if (sent_us_ == 0) {
    if (!readings_.empty()) sent_from_ = readings_.back().at;
    sent_us_ = first_sent_us_ = now_us;
    return Move(positions_[position_]);
  }
  if (now_us - first_sent_us_ > kPositionUs) {
    LeaveOut(!rests_since_us_   ? "the head did not come to rest there"
             : other_sizes_ > 0 ? "its pictures are not of the rig's size"
             : !color_          ? "no colour picture came"
                                : "too few depth frames came");
    return NextPosition(now_us);
  }
  if (!rests_since_us_ && now_us - first_sent_us_ > kNotMovingUs && sent_from_ && !readings_.empty() &&
      Near(readings_.back().at, *sent_from_, kRest_deg)) {
    LeaveOut("the head does not go there; are these angles beyond its limits?");
    return NextPosition(now_us);
  }
  if (!rests_since_us_ && now_us - sent_us_ > kSendAgainUs) {
    sent_us_ = now_us;
    return Move(positions_[position_]);
  }
  return std::nullopt;
}

std::vector<std::string> SweepRecorder::TakeNews() { return std::exchange(news_, {}); }

}  // namespace mixstage
