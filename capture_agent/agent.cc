// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/agent.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <thread>

#include "proto/base/bounded_queue.h"
#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "proto/link/agent_commands.h"
#include "proto/link/epoch.h"

namespace mixstage {
namespace {

constexpr std::size_t kQueuePictures = 8;
constexpr int kCommandPollMs = 100;
constexpr std::int64_t kHeadPeriodUs = 20'000;

TakeList ListOf(Stream stream) {
  switch (stream) {
    case Stream::kColor:
      return TakeList::kColor;
    case Stream::kDepth:
      return TakeList::kDepth;
    case Stream::kAmplitude:
      return TakeList::kAmplitude;
    case Stream::kFisheye:
      break;
  }
  return TakeList::kFisheye;
}

void Record(const Captured& captured, TakeRecorder& recorder) {
  if (const auto* picture = std::get_if<CapturedPicture>(&captured.what)) {
    recorder.Picture(ListOf(picture->stream), captured.t_us, picture->content);
  } else {
    const auto& angles = std::get<CapturedAngles>(captured.what);
    recorder.Head(captured.t_us, angles.pan_deg, angles.tilt_deg);
  }
}

// What the capturing thread hands over. `index` counts everything captured of a stream: a gap is a drop.
struct Queued {
  Captured captured;
  std::int64_t index = 0;
};

void MoveHead(PanTiltHead* head, const AgentCommand& command) {
  if (head == nullptr)
    return spdlog::warn("agent move=refused reason=\"there is no head that can be moved\"");
  if (auto ok = head->MoveTo(command.pan_deg, command.tilt_deg); !ok)
    return spdlog::warn("agent move=refused reason=\"{}\"", ok.error().message);
  spdlog::info("agent move pan_deg={} tilt_deg={}", command.pan_deg, command.tilt_deg);
}

// Hears the server until `stop`.
void HearCommands(LcmLink& link, std::int64_t epoch, PanTiltHead* head, TakeRecorder* recorder,
                  std::atomic<double>& parity, const std::stop_token& stop) {
  CommandReceiver receiver(epoch);
  link.Subscribe({.on_command = [&](const mixstage_lcm::agent_command_t& message) {
    const auto command = receiver.Take(message);
    if (!command) return;
    switch (command->verb) {
      case AgentVerb::kParity:
        parity = command->value * 1e-3;
        return spdlog::info("agent parity={}", parity.load());
      case AgentVerb::kRecord:
        if (recorder == nullptr)
          return spdlog::warn("agent record=refused reason=\"started without --record\"");
        if (auto ok = recorder->Start(); !ok)
          spdlog::warn("agent record=refused reason=\"{}\"", ok.error().message);
        return;
      case AgentVerb::kStopRecording:
        if (recorder != nullptr) recorder->Stop();
        return;
      case AgentVerb::kMoveHead:
        return MoveHead(head, *command);
    }
  }});
  while (!stop.stop_requested()) link.HandleFor(kCommandPollMs);
}

// Tells where the head is until `stop`; the angles that the socket refused.
std::int64_t PublishAngles(PanTiltHead& head, LcmLink& link, std::int64_t epoch, TakeRecorder* recorder,
                           const std::stop_token& stop) {
  std::int64_t send_errors = 0;
  bool answers = true;
  for (std::int64_t due_us = MonotonicMicros(); WaitUntil(due_us, stop);) {
    due_us = std::max(due_us + kHeadPeriodUs, MonotonicMicros());
    const auto reading = head.Read();
    if (!reading && answers) spdlog::warn("head silent reason=\"{}\"", reading.error().message);
    answers = reading.has_value();
    if (!reading) continue;
    mixstage_lcm::head_angles_t message{};
    message.epoch = epoch;
    message.t_us = reading->t_us;
    message.pan_deg = reading->pan_deg;
    message.tilt_deg = reading->tilt_deg;
    send_errors += !link.Publish(message);
    if (recorder != nullptr) recorder->Head(reading->t_us, reading->pan_deg, reading->tilt_deg);
  }
  return send_errors;
}

}  // namespace

AgentTotals RunAgent(Source& source, PanTiltHead* head, Pace pace, LcmLink& link,
                     const PublisherConfig& config, TakeRecorder* recorder, std::stop_token stop) {
  BoundedQueue<Queued> queue(kQueuePictures, pace == Pace::kReal ? WhenFull::kDropOldest : WhenFull::kWait);
  std::atomic<std::int64_t> dropped = 0;
  AgentTotals totals;
  const std::int64_t epoch = RandomEpoch();
  std::atomic<double> parity = config.parity;

  const std::jthread commands(
      [&](const std::stop_token& done) { HearCommands(link, epoch, head, recorder, parity, done); });
  std::atomic<std::int64_t> head_send_errors = 0;
  std::jthread watching_head;
  if (head != nullptr) {
    watching_head = std::jthread([&](const std::stop_token& done) {
      head_send_errors = PublishAngles(*head, link, epoch, recorder, done);
    });
  }
  std::jthread publishing([&] {
    Publisher publisher(config, link, epoch);
    std::array<std::int64_t, 5> next_index{};
    while (auto item = queue.Pop()) {
      if (const auto* picture = std::get_if<CapturedPicture>(&item->captured.what)) {
        std::int64_t& next = next_index[static_cast<std::size_t>(picture->stream)];
        for (; next < item->index; ++next) publisher.SkipPicture(picture->stream);
        ++next;
      }
      publisher.SetParity(parity);
      publisher.Publish(item->captured);
      publisher.PublishHealthIfDue({.dropped = dropped,
                                    .queue = static_cast<int>(queue.size()),
                                    .recording = recorder != nullptr && recorder->status().active});
    }
    totals.published = publisher.published();
    totals.send_errors = publisher.send_errors();
  });
  // A stop must also wake a capture that waits for room in the queue.
  const std::stop_callback close_on_stop(stop, [&] { queue.Close(); });

  std::array<std::int64_t, 5> index{};
  while (!stop.stop_requested()) {
    auto captured = source.Next(stop);
    if (!captured) {
      if (totals.unreadable++ == 0)
        spdlog::warn("source unreadable=1 reason=\"{}\"", captured.error().message);
      continue;
    }
    if (!*captured) break;
    ++totals.captured;
    if (recorder != nullptr) Record(**captured, *recorder);
    std::int64_t number = 0;
    if (const auto* picture = std::get_if<CapturedPicture>(&(*captured)->what)) {
      number = index[static_cast<std::size_t>(picture->stream)]++;
    }
    dropped += queue.Push({std::move(**captured), number});
  }
  queue.Close();
  publishing.join();
  watching_head = {};
  totals.send_errors += head_send_errors;
  totals.dropped = dropped;
  return totals;
}

}  // namespace mixstage
