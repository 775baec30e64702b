// SPDX-License-Identifier: Apache-2.0
#include "server/app/scan_live.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "proto/geometry/rig.h"
#include "proto/link/agent_commands.h"
#include "proto/link/lcm_link.h"
#include "proto/link/reassembler.h"
#include "server/app/sweep_recorder.h"

namespace mixstage {
namespace {

constexpr int kHandleMs = 10;

bool Number(const std::string& text, double& value) {
  char* end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return !text.empty() && end == text.c_str() + text.size() && std::isfinite(value);
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

Status RecordSweep(const LiveScanOptions& options) {
  auto rig = LoadRig(options.rig);
  if (!rig) return tl::unexpected(rig.error());
  if (!rig->rig.depth || !rig->rig.ptu) {
    return Fail(ErrorCode::kBadInput, options.rig.string() + ": has no " +
                                          (rig->rig.depth ? "ptu section" : "depth camera") +
                                          ": mixstage-server calibrate writes a rig that can scan");
  }
  auto positions = SweepGrid(rig->rig, options.area);
  if (!positions) return tl::unexpected(positions.error());
  auto link = LcmLink::Create(options.lcm_url);
  if (!link) return tl::unexpected(link.error());
  auto warnings = (*link)->SelfTest();
  if (!warnings) return tl::unexpected(warnings.error());
  for (const std::string& warning : *warnings) spdlog::warn("lcm {}", warning);
  auto writer = TakeWriter::Create({.folder = options.views, .rig_file = options.rig});
  if (!writer) return tl::unexpected(writer.error());

  SweepRecorder sweep(rig->rig, *positions, std::move(*writer));
  Reassembler reassembler;
  (*link)->Subscribe({
      .on_slice = [&](const mixstage_lcm::frame_slice_t& s) { reassembler.Add(s, MonotonicMicros()); },
      .on_head = [&](const mixstage_lcm::head_angles_t& a) { sweep.OnHead(a, MonotonicMicros()); },
  });
  CommandSender commands;
  while (!sweep.done()) {
    (*link)->HandleFor(kHandleMs);
    const std::int64_t now_us = MonotonicMicros();
    while (auto picture = reassembler.Next(now_us)) sweep.OnPicture(*picture, now_us);
    auto command = sweep.Poll(now_us);
    for (const std::string& line : sweep.TakeNews()) {
      if (!options.silent) std::fprintf(stderr, "sweep: %s\n", line.c_str());
    }
    if (!command) return tl::unexpected(command.error());
    if (*command) commands.Send(**command, sweep.epoch());
    commands.SendDue(**link, now_us);
  }
  // The way home is told as often as any command.
  for (int i = 1; i < CommandSender::kTimes; ++i) {
    const std::int64_t due_us = MonotonicMicros() + CommandSender::kPauseUs;
    while (MonotonicMicros() < due_us) (*link)->HandleFor(kHandleMs);
    commands.SendDue(**link, MonotonicMicros());
  }
  return {};
}

}  // namespace mixstage
