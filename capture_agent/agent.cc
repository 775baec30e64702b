// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/agent.h"

#include <array>
#include <atomic>
#include <random>
#include <thread>

#include "proto/base/bounded_queue.h"
#include "proto/base/log.h"
#include "proto/link/agent_commands.h"

namespace mixstage {
namespace {

constexpr std::size_t kQueuePictures = 8;
constexpr int kCommandPollMs = 100;

std::int64_t RandomEpoch() {
  std::random_device random;
  std::int64_t epoch = 0;
  while (epoch == 0) epoch = static_cast<std::int64_t>((std::uint64_t{random()} << 32) | random());
  return epoch;
}

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

// Hears the server until `stop`.
void HearCommands(LcmLink& link, std::int64_t epoch, TakeRecorder* recorder, std::atomic<double>& parity,
                  const std::stop_token& stop) {
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
    }
  }});
  while (!stop.stop_requested()) link.HandleFor(kCommandPollMs);
}

}  // namespace

AgentTotals RunAgent(Source& source, Pace pace, LcmLink& link, const PublisherConfig& config,
                     TakeRecorder* recorder, std::stop_token stop) {
  BoundedQueue<Queued> queue(kQueuePictures, pace == Pace::kReal ? WhenFull::kDropOldest : WhenFull::kWait);
  std::atomic<std::int64_t> dropped = 0;
  AgentTotals totals;
  const std::int64_t epoch = RandomEpoch();
  std::atomic<double> parity = config.parity;

  const std::jthread commands(
      [&](const std::stop_token& done) { HearCommands(link, epoch, recorder, parity, done); });
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
  totals.dropped = dropped;
  return totals;
}

}  // namespace mixstage
