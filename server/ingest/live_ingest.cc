// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/live_ingest.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"

namespace mixstage {
namespace {

constexpr std::size_t kKeptDepths = 4;
constexpr std::size_t kMaxAgents = 8;
constexpr std::int64_t kTransportPeriodUs = 250'000;

}  // namespace

LiveIngest::LiveIngest(const Rig& rig, CapturedFrames& out, TakeRecorder* recorder)
    : rig_(rig), out_(out), recorder_(recorder) {}

void LiveIngest::OnSlice(const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us) {
  reassembler_.Add(slice, now_us);
  TakePictures(now_us);
}

void LiveIngest::Poll(std::int64_t now_us) {
  TakePictures(now_us);
  if (now_us < transport_due_us_) return;
  transport_due_us_ = now_us + kTransportPeriodUs;
  PublishTransportCounters(now_us);
}

void LiveIngest::TakePictures(std::int64_t now_us) {
  while (auto encoded = reassembler_.Next(now_us)) OnPicture(*encoded, now_us);
}

void LiveIngest::OnPicture(const EncodedFrame& encoded, std::int64_t now_us) {
  if (!Follows(encoded.epoch, now_us)) return Drop("other_agent");
  clock_.Observe(encoded.t_us, now_us);
  delay_.Add(now_us - clock_.ToServer(encoded.t_us), now_us);
  switch (encoded.stream) {
    case Stream::kColor:
      return OnColor(encoded, now_us);
    case Stream::kDepth:
    case Stream::kAmplitude:
      return OnDepth(encoded, now_us);
    case Stream::kFisheye:  // the tracker's, once there is one
      if (recorder_ != nullptr)
        recorder_->Picture(TakeList::kFisheye, clock_.ToServer(encoded.t_us), encoded.bytes);
      return;
  }
}

// Counters of the transport that are not zero, as drop reasons, and what is known of each agent's way here.
void LiveIngest::PublishTransportCounters(std::int64_t now_us) {
  const Reassembler::Counters& c = reassembler_.counters();
  const double delay_ms = delay_.MedianMs(now_us);
  const std::lock_guard lock(mutex_);
  for (const auto& [reason, count] :
       {std::pair{"bad_slice", c.bad_slice}, std::pair{"duplicate_slice", c.duplicate_slice},
        std::pair{"late_slice", c.late_slice}, std::pair{"incomplete", c.incomplete}, std::pair{"crc", c.crc},
        std::pair{"quota", c.quota}, std::pair{"no_room", c.no_room}}) {
    if (count > 0) status_.drops[reason] = count;
  }
  for (AgentStatus& agent : status_.agents) {
    const Reassembler::SourceStats stats = reassembler_.Stats(agent.epoch, now_us);
    agent.repaired = stats.repaired;
    agent.slice_loss = stats.slice_loss;
    agent.delay_ms = agent.epoch == followed_epoch_ ? delay_ms : 0;
  }
}

bool LiveIngest::Follows(std::int64_t epoch, std::int64_t now_us) {
  if (epoch != followed_epoch_) {
    if (followed_epoch_ != 0 && now_us - followed_heard_us_ < kSwitchUs) return false;
    spdlog::info("ingest agent_epoch={:016x}", static_cast<std::uint64_t>(epoch));
    followed_epoch_ = epoch;
    clock_ = ClockMap();
    delay_ = DelayWindow();
    next_sequence_ = -1;
    depths_.clear();
    amplitude_.release();
    head_.Clear();
  }
  followed_heard_us_ = now_us;
  return true;
}

void LiveIngest::OnColor(const EncodedFrame& encoded, std::int64_t now_us) {
  // Numbers that the agent's sequence skips are pictures that were lost; the first of an epoch skips none. A
  // step back is the reassembler's new start after a number that was a lie: it skips none either.
  std::int64_t lost = 0;
  if (next_sequence_ >= 0) lost = std::clamp<std::int64_t>(encoded.sequence - next_sequence_, 0, 1'000'000);
  next_sequence_ = encoded.sequence + 1;
  next_frame_ += lost;
  if (lost > 0) {
    Drop("lost", lost);
    const std::lock_guard lock(mutex_);
    Agent(encoded.epoch, now_us).lost += lost;
  }
  auto frame = std::make_shared<CapturedFrame>();
  frame->frame = next_frame_++;
  frame->epoch = encoded.epoch;
  frame->capture_us = clock_.ToServer(encoded.t_us);
  const std::int64_t wall_us = MonotonicMicros();
  const std::int64_t cpu_us = ThreadCpuMicros();
  const auto header = jpeg_.ReadHeader(encoded.bytes);
  if (header && (header->width != rig_.color.width || header->height != rig_.color.height)) {
    return Drop("color_size_not_rig");  // before a picture of another size costs memory and time
  }
  if (auto ok = jpeg_.Decode(encoded.bytes, frame->color); !ok) {
    spdlog::debug("ingest reason=\"{}\"", ok.error().message);
    return Drop("bad_jpeg");
  }
  if (recorder_ != nullptr) recorder_->Picture(TakeList::kColor, frame->capture_us, encoded.bytes);
  frame->depth = NewestDepthBefore(frame->capture_us);
  frame->head = head_.At(encoded.t_us);
  {
    const std::lock_guard lock(mutex_);
    ++status_.color_pictures;
    status_.last_color_us = now_us;
    status_.decode_wall_ms = static_cast<double>(MonotonicMicros() - wall_us) * 1e-3;
    status_.decode_cpu_ms = static_cast<double>(ThreadCpuMicros() - cpu_us) * 1e-3;
    Agent(encoded.epoch, now_us).last_heard_us = now_us;
  }
  if (out_.Push(std::move(frame)) > 0) Drop("late");
}

void LiveIngest::OnDepth(const EncodedFrame& encoded, std::int64_t now_us) {
  cv::Mat1w picture;
  if (auto ok = depth_decoder_.Decode(encoded.bytes, picture); !ok) return Drop("bad_depth");
  if (!rig_.depth || picture.cols != rig_.depth->camera.width || picture.rows != rig_.depth->camera.height) {
    return Drop("depth_size_not_rig");
  }
  if (recorder_ != nullptr) {
    recorder_->Picture(encoded.stream == Stream::kDepth ? TakeList::kDepth : TakeList::kAmplitude,
                       clock_.ToServer(encoded.t_us), picture);
  }
  if (encoded.stream == Stream::kAmplitude) {
    amplitude_t_us_ = encoded.t_us;
    amplitude_ = picture;
    // Depth and amplitude of one exposure come as two pictures in either order.
    if (!depths_.empty() && depths_.back()->sequence == encoded.sequence &&
        depths_.back()->amplitude.empty()) {
      auto with = std::make_shared<DepthPicture>(*depths_.back());
      with->amplitude = picture;
      depths_.back() = std::move(with);
    }
    return;
  }
  auto depth = std::make_shared<DepthPicture>();
  depth->capture_us = clock_.ToServer(encoded.t_us) + std::llround(rig_.depth_time_offset_s * 1e6);
  depth->sequence = encoded.sequence;
  depth->counts = picture;
  if (amplitude_t_us_ == encoded.t_us) depth->amplitude = amplitude_;
  depths_.push_back(std::move(depth));
  if (depths_.size() > kKeptDepths) depths_.pop_front();
  const std::lock_guard lock(mutex_);
  ++status_.depth_pictures;
  status_.last_depth_us = now_us;
}

std::shared_ptr<const DepthPicture> LiveIngest::NewestDepthBefore(std::int64_t capture_us) const {
  for (auto it = depths_.rbegin(); it != depths_.rend(); ++it) {
    if ((*it)->capture_us > capture_us) continue;
    return capture_us - (*it)->capture_us <= kDepthStaleUs ? *it : nullptr;
  }
  return nullptr;
}

void LiveIngest::OnHead(const mixstage_lcm::head_angles_t& angles, std::int64_t now_us) {
  if (angles.epoch == 0 || !IsCountable(angles.t_us) || !std::isfinite(angles.pan_deg) ||
      !std::isfinite(angles.tilt_deg)) {
    return Drop("bad_head");
  }
  if (angles.epoch != followed_epoch_) return;
  clock_.Observe(angles.t_us, now_us);
  head_.Add(angles.t_us, {angles.pan_deg, angles.tilt_deg});
  if (recorder_ != nullptr) recorder_->Head(clock_.ToServer(angles.t_us), angles.pan_deg, angles.tilt_deg);
}

void LiveIngest::OnHealth(const mixstage_lcm::agent_health_t& health, std::int64_t now_us) {
  const bool finite = std::isfinite(health.color_fps) && std::isfinite(health.depth_fps) &&
                      std::isfinite(health.fisheye_fps) && std::isfinite(health.encode_ms);
  const bool countable =
      IsCountable(health.published) && IsCountable(health.dropped) && IsCountable(health.send_errors);
  if (health.epoch == 0 || !finite || !countable) return Drop("bad_health");
  const std::lock_guard lock(mutex_);
  AgentStatus& agent = Agent(health.epoch, now_us);
  const auto* name = reinterpret_cast<const char*>(health.name);
  agent.name.assign(name, std::find(name, name + sizeof health.name, '\0'));
  // The name goes into JSON, metrics and logs: printable ASCII only.
  std::replace_if(
      agent.name.begin(), agent.name.end(),
      [](char c) { return c < ' ' || c > '~' || c == '"' || c == '\\'; }, '?');
  agent.last_heard_us = now_us;
  agent.color_fps = health.color_fps;
  agent.depth_fps = health.depth_fps;
  agent.fisheye_fps = health.fisheye_fps;
  agent.encode_ms = health.encode_ms;
  agent.queue = health.queue;
  agent.dropped = health.dropped;
  agent.send_errors = health.send_errors;
  agent.recording = health.recording != 0;
}

void LiveIngest::OnScan(const mixstage_lcm::scan_progress_t& message, std::int64_t now_us) {
  auto progress = ReadScanProgress(message);
  if (!progress) return Drop("bad_scan");
  {
    const std::lock_guard lock(mutex_);
    const ScanStatus* known = status_.scan ? &*status_.scan : nullptr;
    const bool same = known != nullptr && known->epoch == message.epoch;
    if (same && message.sequence <= known->sequence) return;  // came twice, or late
    if (same || known == nullptr || known->progress.state >= ScanState::kDone ||
        now_us - known->last_heard_us > kScanSilentUs) {
      status_.scan = ScanStatus{message.epoch, message.sequence, now_us, std::move(*progress)};
      return;
    }
  }
  Drop("other_scan");
}

// Called with mutex_ held. The list is short; the one not heard for longest makes room.
AgentStatus& LiveIngest::Agent(std::int64_t epoch, std::int64_t now_us) {
  auto& agents = status_.agents;
  auto found =
      std::find_if(agents.begin(), agents.end(), [&](const AgentStatus& a) { return a.epoch == epoch; });
  if (found != agents.end()) return *found;
  if (agents.size() >= kMaxAgents) {
    agents.erase(std::min_element(
        agents.begin(), agents.end(),
        [](const AgentStatus& a, const AgentStatus& b) { return a.last_heard_us < b.last_heard_us; }));
  }
  ++epochs_heard_;
  AgentStatus agent;
  agent.epoch = epoch;
  agent.last_heard_us = now_us;
  return agents.emplace_back(std::move(agent));
}

void LiveIngest::Drop(const char* reason, std::int64_t count) {
  const std::lock_guard lock(mutex_);
  status_.drops[reason] += count;
}

IngestStatus LiveIngest::Status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

}  // namespace mixstage
