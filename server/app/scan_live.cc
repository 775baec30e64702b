// SPDX-License-Identifier: Apache-2.0
#include "server/app/scan_live.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "proto/geometry/rig.h"
#include "proto/link/agent_commands.h"
#include "proto/link/lcm_link.h"
#include "proto/link/reassembler.h"
#include "server/app/progress_sender.h"
#include "server/app/sweep_recorder.h"

namespace mixstage {
namespace {

constexpr int kHandleMs = 10;

bool Number(const std::string& text, double& value) {
  char* end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return !text.empty() && end == text.c_str() + text.size() && std::isfinite(value);
}

// Returns when all positions are recorded or left out, and the head is on its way back.
Status RecordSweep(SweepRecorder& sweep, std::unique_ptr<LcmLink> link, ProgressSender& sender, bool silent) {
  Reassembler reassembler;
  link->Subscribe({
      .on_slice = [&](const mixstage_lcm::frame_slice_t& s) { reassembler.Add(s, MonotonicMicros()); },
      .on_head = [&](const mixstage_lcm::head_angles_t& a) { sweep.OnHead(a, MonotonicMicros()); },
  });
  CommandSender commands;
  while (!sweep.done()) {
    link->HandleFor(kHandleMs);
    const std::int64_t now_us = MonotonicMicros();
    while (auto picture = reassembler.Next(now_us)) sweep.OnPicture(*picture, now_us);
    auto command = sweep.Poll(now_us);
    const std::vector<std::string> news = sweep.TakeNews();
    for (const std::string& line : news) {
      if (!silent) std::fprintf(stderr, "sweep: %s\n", line.c_str());
    }
    if (!command) return tl::unexpected(command.error());
    if (!news.empty() || *command) sender.Say(sweep.Progress());
    if (*command) commands.Send(**command, sweep.epoch());
    commands.SendDue(*link, now_us);
  }
  // The way home is told as often as any command.
  for (int i = 1; i < CommandSender::kTimes; ++i) {
    const std::int64_t due_us = MonotonicMicros() + CommandSender::kPauseUs;
    while (MonotonicMicros() < due_us) link->HandleFor(kHandleMs);
    commands.SendDue(*link, MonotonicMicros());
  }
  return {};
}

}  // namespace

Status ParseSpan(const std::string& text, double& from_deg, double& to_deg) {
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos || !Number(text.substr(0, colon), from_deg) ||
      !Number(text.substr(colon + 1), to_deg)) {
    return Fail(ErrorCode::kInvalidConfig, text + " is not A:B, two angles in degrees");
  }
  return {};
}

Result<ScanOutcome> ScanLive(const LiveScanOptions& options) {
  auto rig = LoadRig(options.rig);
  if (!rig) return tl::unexpected(rig.error());
  if (!rig->rig.depth || !rig->rig.ptu) {
    return Fail(ErrorCode::kBadInput, options.rig.string() + ": has no " +
                                          (rig->rig.depth ? "ptu section" : "depth camera") +
                                          ": mixstage-server calibrate writes a rig that can scan");
  }
  auto positions = SweepGrid(rig->rig, options.area);
  if (!positions) return tl::unexpected(positions.error());
  if (positions->size() > kMaxSweepPositions) {
    return Fail(ErrorCode::kInvalidConfig, options.rig.string() +
                                               ": its cameras see so little that a sweep has " +
                                               std::to_string(positions->size()) + " positions");
  }
  auto link = LcmLink::Create(options.lcm_url);
  if (!link) return tl::unexpected(link.error());
  auto warnings = (*link)->SelfTest();
  if (!warnings) return tl::unexpected(warnings.error());
  for (const std::string& warning : *warnings) spdlog::warn("lcm {}", warning);
  const std::filesystem::path views = options.out / "views";
  auto writer = TakeWriter::Create({.folder = views, .rig_file = options.rig});
  if (!writer) return tl::unexpected(writer.error());
  // A link of its own: it hears nothing, whatever comes while the room is computed.
  auto telling = LcmLink::Create(options.lcm_url);
  if (!telling) return tl::unexpected(telling.error());

  SweepRecorder sweep(rig->rig, *positions, std::move(*writer));
  // What the socket refuses is lost: a scan goes on without listeners.
  ProgressSender sender([&](const mixstage_lcm::scan_progress_t& m) { (void)(*telling)->Publish(m); },
                        sweep.Progress());
  ScanProgress progress;
  auto outcome = [&]() -> Result<ScanOutcome> {
    const Status swept = RecordSweep(sweep, std::move(*link), sender, options.silent);
    progress = sweep.Progress();
    if (!swept) return tl::unexpected(swept.error());
    progress.state = ScanState::kCompute;
    return RunScan({.views = views,
                    .rig = options.rig,
                    .out = options.out,
                    .merge = options.merge,
                    .patch = options.patch,
                    .silent = options.silent,
                    .on_step = [&](const std::string& step) {
                      progress.text = step;
                      sender.Say(progress);
                    }});
  }();
  if (outcome) {
    progress.state = ScanState::kDone;
    progress.text.clear();
    progress.coverage = outcome->coverage;
    progress.triangles = outcome->triangles;
    progress.left_out =
        std::min(progress.positions, progress.left_out + static_cast<int>(outcome->left_out.size()));
    for (const ViewNote& note : outcome->left_out)
      progress.notes += "view " + note.view + ": " + note.reason + "\n";
  } else {
    progress.state = ScanState::kFailed;
    progress.text = outcome.error().message;
  }
  sender.Say(progress);
  return outcome;
}

}  // namespace mixstage
