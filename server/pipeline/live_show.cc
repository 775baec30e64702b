// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/live_show.h"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "server/composite/relight.h"
#include "server/pipeline/frame_stages.h"

namespace mixstage {
namespace {

constexpr int kHandleMs = 50;
constexpr std::int64_t kStatsWindowUs = 10'000'000;
constexpr std::int64_t kRateWindowUs = 2'000'000;  // of fps and bitrate
constexpr auto kStatsPeriod = std::chrono::milliseconds(500);
constexpr std::int64_t kGreetPauseUs = 1'000'000;
constexpr std::int64_t kSilentUs = 3'000'000;  // an agent not heard for this long is gone
constexpr std::int64_t kNudgeToldUs = 60'000'000;
constexpr std::int64_t kScanToldUs = 60'000'000;  // after a scan's last word
constexpr std::int64_t kStalledUs = 2'000'000;    // no colour for this long: say so
// 12.5 Hz, less half a colour frame: capture times tremble.
constexpr std::int64_t kMeshPeriodUs = 65'000;
constexpr std::int64_t kLightMapPeriodUs = 95'000;
constexpr int kLightMapQuality = 85;  // of JPEG
constexpr std::int64_t kDepthStoppedUs = 200'000;
constexpr std::size_t kStageWindow = 300;  // frames behind the page's stage times

void NameThread(const char* name) { pthread_setname_np(pthread_self(), name); }

std::string Sentence(const char* format, double value) {
  char text[160];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

WatchScan Told(const ScanStatus& scan, double age_s) {
  const ScanProgress& p = scan.progress;
  const auto count = [](int n) { return static_cast<std::uint64_t>(n); };
  constexpr std::array kStates = {"sweep", "compute", "done", "failed"};
  WatchScan told;
  told.state = kStates[static_cast<std::size_t>(p.state) - 1];
  told.age_s = age_s;
  told.positions = count(p.positions);
  told.recorded = count(p.recorded);
  told.left_out = count(p.left_out);
  told.columns = p.map.columns;
  told.rows = p.map.rows;
  for (const SweepCell cell : p.map.cells) told.cells += static_cast<char>('0' + static_cast<int>(cell));
  std::copy(p.map.pan_deg.begin(), p.map.pan_deg.end(), told.pan_deg.begin());
  std::copy(p.map.tilt_deg.begin(), p.map.tilt_deg.end(), told.tilt_deg.begin());
  told.text = p.text;
  told.notes = p.notes;
  told.coverage = p.coverage;
  told.triangles = count(p.triangles);
  return told;
}

}  // namespace

LiveShow::LiveShow(LiveShowParts parts, Gateway& gateway)
    : link_(std::move(parts.link)),
      studio_(std::move(parts.studio)),
      broadcast_(std::move(parts.broadcast)),
      meshes_(std::move(parts.meshes)),
      gateway_(gateway),
      recorder_(std::move(parts.recorder)),
      osc_(std::move(parts.osc)),
      director_(parts.director),
      ingest_(studio_.rig(), captured_, recorder_.get()),
      times_(kStageWindow) {
  encode_thread_ = std::jthread([this] { RunEncode(); });
  mesh_thread_ = std::jthread([this] { RunMeshes(); });
  frame_thread_ = std::jthread([this] { RunFrames(); });
  ingest_thread_ = std::jthread([this](const std::stop_token& stop) { RunIngest(stop); });
  stats_thread_ = std::jthread([this](const std::stop_token& stop) { RunStats(stop); });
}

LiveShow::~LiveShow() {
  ingest_thread_.request_stop();
  stats_thread_.request_stop();
  captured_.Close();
  finished_.Close();
  mesh_jobs_.Close();
  for (std::jthread* thread :
       {&ingest_thread_, &frame_thread_, &encode_thread_, &mesh_thread_, &stats_thread_})
    thread->join();
}

void LiveShow::RunIngest(const std::stop_token& stop) {
  NameThread("ingest");
  link_->Subscribe({
      .on_slice = [this](const mixstage_lcm::frame_slice_t& s) { ingest_.OnSlice(s, MonotonicMicros()); },
      .on_head = [this](const mixstage_lcm::head_angles_t& a) { ingest_.OnHead(a, MonotonicMicros()); },
      .on_health = [this](const mixstage_lcm::agent_health_t& h) { ingest_.OnHealth(h, MonotonicMicros()); },
      .on_scan = [this](const mixstage_lcm::scan_progress_t& s) { ingest_.OnScan(s, MonotonicMicros()); },
  });
  while (!stop.stop_requested()) {
    link_->HandleFor(kHandleMs);
    const std::int64_t now_us = MonotonicMicros();
    ingest_.Poll(now_us);
    GreetNewAgents(now_us);
    commands_.SendDue(*link_, now_us);
  }
}

// An agent that starts after the server has missed what was said at its start. Whoever forges agents gets one
// command a second out of it, not one for each.
void LiveShow::GreetNewAgents(std::int64_t now_us) {
  if (parity_thousandths_ < 0 || now_us < greet_due_us_) return;
  const std::int64_t heard = ingest_.epochs_heard();
  if (heard == epochs_greeted_) return;
  epochs_greeted_ = heard;
  greet_due_us_ = now_us + kGreetPauseUs;
  SendToAgents({.verb = AgentVerb::kParity, .value = parity_thousandths_});
}

void LiveShow::SendToAgents(AgentCommand command, std::int64_t target_epoch) {
  commands_.Send(command, target_epoch);
}

void LiveShow::SetAgentParity(double share) {
  parity_thousandths_ = static_cast<int>(std::lround(share * kMaxParityThousandths));
  SendToAgents({.verb = AgentVerb::kParity, .value = parity_thousandths_});
}

void LiveShow::RunFrames() {
  NameThread("frame");
  FramePool pool;
  while (auto captured = captured_.Pop()) {
    std::shared_ptr<Frame> frame = pool.Take();
    frame->captured = std::move(*captured);
    if (director_ != nullptr) {
      if (auto scene = director_->TakeScene()) studio_.SetScene(std::move(scene));
      if (const auto at = director_->TakeLook()) studio_.LookForThing(at->u, at->v);
    }
    studio_.Run(*frame, times_);
    for (const PhysicsEvent& event : frame->events) {
      events_.Send(event, *link_);
      if (osc_) osc_->Send(event);
    }
    if (director_ != nullptr) {
      director_->SeeRoom(studio_.view_room(), frame->T_world_view);
      if (auto moved = studio_.TakeMoved(); !moved.empty()) director_->SeeMoved(std::move(moved));
      if (auto thing = studio_.TakeThing()) director_->SeeThing(std::move(*thing));
    }
    {
      const std::lock_guard lock(mutex_);
      if (studio_.scene()) scene_revision_ = studio_.scene()->revision;
      room_state_ = studio_.room_state();
      if (const double nudge_px = studio_.TakeNudge_px(); nudge_px > 0) {
        nudge_px_ = nudge_px;
        nudged_us_ = MonotonicMicros();
      }
      if (studio_.depth_clock())
        depth_clock_ms_ = 1e-3 * static_cast<double>(studio_.depth_clock_applied_us());
      T_scene_color_ = studio_.TSceneColor(*frame);
      for (const PhysicsEvent& event : frame->events) {
        contacts_.push_front(event);
        if (contacts_.size() > kMaxStatsContacts) contacts_.pop_back();
      }
    }
    OfferMeshes(frame);
    OfferLightMap(*frame);
    if (finished_.Push(std::move(frame)) > 0) CountDrop("late");
  }
}

// At the depth camera's rate, 12.5 Hz at most: between two depth pictures the surface has nothing new. Where
// depth has stopped the matte still moves.
void LiveShow::OfferMeshes(const std::shared_ptr<const Frame>& frame) {
  if (!gateway_.WantsStream(WatchStream::kActorMesh)) return;
  const CapturedFrame& captured = *frame->captured;
  const std::int64_t since_us = captured.capture_us - meshed_us_;
  const bool new_depth = captured.depth != meshed_depth_;
  if (since_us >= 0 && since_us < (new_depth ? kMeshPeriodUs : kDepthStoppedUs)) return;
  meshed_us_ = captured.capture_us;
  meshed_depth_ = captured.depth;
  mesh_jobs_.Push(MakeMeshJob(studio_, frame));
}

void LiveShow::OfferLightMap(const Frame& frame) {
  const std::int64_t since_us = frame.captured->capture_us - light_map_us_;
  if (!gateway_.WantsStream(WatchStream::kLightMap) || (since_us >= 0 && since_us < kLightMapPeriodUs))
    return;
  light_map_us_ = frame.captured->capture_us;
  const cv::Mat1b& alpha = frame.alpha;
  const cv::Mat3b map = frame.light_map != nullptr
                            ? LightMapPicture(*frame.light_map, View(alpha), alpha.size(), 2)
                            : cv::Mat3b(Half(alpha.rows), Half(alpha.cols), cv::Vec3b::all(255));
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", OnWhite(map), jpeg, {cv::IMWRITE_JPEG_QUALITY, kLightMapQuality});
  gateway_.PublishWhole(MakeLightMapMessage({.stream = WatchStream::kLightMap,
                                             .key_frame = true,
                                             .frame = static_cast<std::uint64_t>(frame.captured->frame),
                                             .capture_us = frame.captured->capture_us,
                                             .encoded_us = MonotonicMicros()},
                                            jpeg));
}

void LiveShow::RunMeshes() {
  NameThread("mesh");
  while (auto job = mesh_jobs_.Pop()) {
    if (auto ok = meshes_.Send(*job, times_); !ok) {
      CountDrop("mesh");
      spdlog::debug("mesh reason=\"{}\"", ok.error().message);
    }
  }
}

void LiveShow::RunEncode() {
  NameThread("encode");
  std::int64_t bytes_before = 0;
  while (auto frame = finished_.Pop()) {
    if (auto ok = broadcast_.Send(**frame, times_); !ok) {
      CountDrop("encoder");
      const std::lock_guard lock(mutex_);
      if (failure_.empty()) spdlog::error("encode reason=\"{}\"", ok.error().message);
      failure_ = ok.error().message;
      continue;
    }
    const std::int64_t bytes = broadcast_.bytes_sent();
    const std::lock_guard lock(mutex_);
    ++frames_;
    shown_.push_back(
        {(*frame)->encoded_us, (*frame)->encoded_us - (*frame)->captured->capture_us, bytes - bytes_before});
    bytes_before = bytes_ = bytes;
    while (shown_.front().encoded_us < (*frame)->encoded_us - kStatsWindowUs) shown_.pop_front();
  }
}

void LiveShow::RunStats(const std::stop_token& stop) {
  NameThread("stats");
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(kStatsPeriod);
    gateway_.PublishStats(ToJson(Stats()));
  }
}

void LiveShow::CountDrop(const char* reason) {
  const std::lock_guard lock(mutex_);
  ++drops_[reason];
}

std::string LiveShow::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

WatchStats LiveShow::Stats() const {
  const IngestStatus in = ingest_.Status();
  const std::int64_t now_us = MonotonicMicros();  // after the status: no age may be negative
  WatchStats stats;
  stats.server_us = now_us;
  stats.width = studio_.view().width;
  stats.height = studio_.view().height;
  stats.viewers = gateway_.counters().viewers;
  stats.depth_age_s = in.last_depth_us > 0 ? static_cast<double>(now_us - in.last_depth_us) * 1e-6 : 0;
  for (const auto& [reason, count] : in.drops) stats.drops[reason] += static_cast<std::uint64_t>(count);
  RoomState room_state{};
  double nudge_px = 0;
  {
    const std::lock_guard lock(mutex_);
    room_state = room_state_;
    if (nudge_px_ > 0 && now_us - nudged_us_ < kNudgeToldUs) nudge_px = nudge_px_;
    stats.depth_clock_ms = depth_clock_ms_;
    stats.frames = static_cast<std::uint64_t>(frames_);
    for (const auto& [reason, count] : drops_) stats.drops[reason] += static_cast<std::uint64_t>(count);
    std::vector<float> latency_ms;
    std::int64_t recent = 0;
    std::int64_t recent_bytes = 0;
    for (const Shown& s : shown_) {
      if (s.encoded_us < now_us - kStatsWindowUs) continue;
      latency_ms.push_back(static_cast<float>(s.latency_us) * 1e-3f);
      if (s.encoded_us < now_us - kRateWindowUs) continue;
      ++recent;
      recent_bytes += s.bytes;
    }
    stats.fps = static_cast<double>(recent) * 1e6 / kRateWindowUs;
    stats.bitrate_bps = static_cast<double>(recent_bytes) * 8e6 / kRateWindowUs;
    const Distribution latency = DistributionOf(std::move(latency_ms));
    stats.latency_p50_ms = latency.p50;
    stats.latency_p99_ms = latency.p99;
    for (const PhysicsEvent& event : contacts_) {
      const std::int64_t age_us = std::max<std::int64_t>(0, now_us - event.t_us);
      if (age_us > kStatsWindowUs) break;
      stats.contacts.push_back({static_cast<double>(age_us) * 1e-6, PhysicsEventName(event.kind), event.name,
                                event.with, event.impulse_ns, event.text});
    }
    if (T_scene_color_) {
      using Rows = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
      Eigen::Map<Rows>(stats.T_scene_color.emplace().data()) = T_scene_color_->matrix().topRows<3>();
    }
  }
  const std::uint64_t slow = gateway_.counters().dropped_viewer_slow;
  if (slow > 0) stats.drops["viewer_slow"] = slow;

  const auto measured = times_.Summary();
  for (const StageInfo& stage : AllStages()) {
    const auto found = measured.find(std::string(stage.name));
    if (stage.name == "decode") {
      stats.stages.push_back({"decode", stage.budget_ms, in.decode_wall_ms, in.decode_cpu_ms});
    } else if (found != measured.end()) {
      stats.stages.push_back(
          {found->first, stage.budget_ms, found->second.wall_ms.mean, found->second.cpu_ms.mean});
    }
  }
  if (recorder_) {
    const RecordingStatus recording = recorder_->status();
    stats.recording = {recording.active, recording.seconds, static_cast<std::uint64_t>(recording.dropped)};
  }
  if (in.scan && now_us - in.scan->last_heard_us < kScanToldUs)
    stats.scan = Told(*in.scan, static_cast<double>(now_us - in.scan->last_heard_us) * 1e-6);
  bool agent_lives = false;
  for (const AgentStatus& a : in.agents) {
    const double age_s = static_cast<double>(now_us - a.last_heard_us) * 1e-6;
    if (now_us - a.last_heard_us > 10 * kSilentUs) continue;
    agent_lives = agent_lives || now_us - a.last_heard_us < kSilentUs;
    char epoch[17];
    std::snprintf(epoch, sizeof epoch, "%016llx", static_cast<unsigned long long>(a.epoch));
    stats.agents.push_back({epoch, a.name, age_s, a.color_fps, a.depth_fps,
                            static_cast<std::uint64_t>(std::max<std::int64_t>(0, a.dropped)),
                            static_cast<std::uint64_t>(std::max<std::int64_t>(0, a.queue)), a.encode_ms,
                            static_cast<std::uint64_t>(a.lost), static_cast<std::uint64_t>(a.repaired),
                            a.slice_loss, a.delay_ms, a.recording});
  }
  const double color_age_s = static_cast<double>(now_us - in.last_color_us) * 1e-6;
  if (!agent_lives) {
    stats.state = "no_agent";
    stats.message = "No agent is publishing. Start mixstage-agent on the rig's machine.";
  } else if (in.last_color_us == 0 || now_us - in.last_color_us > kStalledUs) {
    stats.state = "stalled";
    stats.message = in.last_color_us == 0
                        ? "The agent lives, but no colour picture has come. Is its size the rig's?"
                        : Sentence("Colour stopped %.0f s ago: the last picture stands. Look at the camera.",
                                   color_age_s);
  } else if (room_state == RoomState::kLearning) {
    stats.state = "learning";
    stats.message = "Learning the empty set. Keep out of the picture for a second.";
  } else if (studio_.rig().depth && (in.last_depth_us == 0 || stats.depth_age_s > 1.0)) {
    stats.state = "no_depth";
    stats.message =
        in.last_depth_us == 0
            ? "No depth has come: the key works by colour alone."
            : Sentence("Depth stopped %.0f s ago: the key works by colour alone.", stats.depth_age_s);
  } else {
    stats.state = "live";
    if (nudge_px > 0)
      stats.message = Sentence(
          "The camera was nudged by %.0f px: the empty set was moved along. Learn it anew when it is empty.",
          nudge_px);
  }
  return stats;
}

}  // namespace mixstage
