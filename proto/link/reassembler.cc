// SPDX-License-Identifier: Apache-2.0
#include "proto/link/reassembler.h"

#include <algorithm>
#include <utility>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// A picture that got nothing while so many slices of its source came is dead: a number that was a lie, most
// likely. Agents send one picture after another, or a few streams in turn.
constexpr std::int64_t kDeadSlices = 512;
// Slices of a finished picture are counted for so long before they are called lost.
constexpr std::int64_t kSettleSlices = 2 * Reassembler::kReorderSlices, kSettleUs = 500'000;
constexpr std::size_t kMaxSettling = 64;
constexpr std::int64_t kSweepUs = 5'000;

}  // namespace

void Reassembler::Add(const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us) {
  ++counters_.slices;
  if (!ValidateSlice(slice)) {
    ++counters_.bad_slice;
    return;
  }
  Source* source = FindSource(slice.epoch, now_us);
  if (source == nullptr) {
    ++counters_.no_room;
    return;
  }
  if (!source->quota.TakeSlice(now_us)) {
    ++counters_.quota;
    return;
  }
  StreamState& stream = source->streams[static_cast<std::size_t>(slice.stream)];
  auto found = stream.open.find(KeyOf(slice));
  if (found == stream.open.end()) {
    if (slice.sequence <= stream.finished_up_to && now_us - stream.finished_us < kResyncUs)
      return AddToSettling(*source, stream, slice);
    if (slice.sequence <= stream.finished_up_to) stream.finished_up_to = -1;
    found = OpenNew(*source, stream, slice, now_us);
    if (found == stream.open.end()) return;
  }
  Open& open = found->second;
  switch (open.picture.Add(slice)) {
    case OpenPicture::Brought::kDuplicate:
      ++counters_.duplicate_slice;
      return;
    case OpenPicture::Brought::kSpare:
      ++counters_.spare_slice;
      ++source->slices;
      return ReleaseAll(*source, now_us);
    case OpenPicture::Brought::kContradiction:
      ++counters_.bad_slice;
      break;
    case OpenPicture::Brought::kNew:
      ++source->slices;
      break;
  }
  open.touched_at = source->slices;
  if (open.picture.TryFinish(coder_)) {
    ++stream.waiting;
  } else if (open.picture.complete()) {
    GiveUp(*source, stream, found, now_us);
  }
  ReleaseAll(*source, now_us);
}

std::optional<EncodedFrame> Reassembler::Next(std::int64_t now_us) {
  if (ready_.empty() && now_us >= next_sweep_us_) {
    next_sweep_us_ = now_us + kSweepUs;
    for (auto& [epoch, source] : sources_) ReleaseAll(source, now_us);
  }
  if (ready_.empty()) return std::nullopt;
  std::optional<EncodedFrame> next(std::move(ready_.front()));
  ready_.pop_front();
  return next;
}

Reassembler::SourceStats Reassembler::Stats(std::int64_t epoch, std::int64_t now_us) {
  const auto found = sources_.find(epoch);
  if (found == sources_.end()) return {};
  for (StreamState& stream : found->second.streams) SettleOld(found->second, stream, now_us);
  return {found->second.repaired, found->second.loss.Share(now_us)};
}

Reassembler::Source* Reassembler::FindSource(std::int64_t epoch, std::int64_t now_us) {
  auto found = sources_.find(epoch);
  if (found == sources_.end()) {
    if (static_cast<int>(sources_.size()) >= kMaxSources) {
      auto spare_us = [&](const Source& s) {  // silent for longer than it may be
        return now_us - s.last_heard_us - (s.proven ? kSourceSilenceUs : kUnprovenSilenceUs);
      };
      const auto quietest = std::max_element(
          sources_.begin(), sources_.end(),
          [&](const auto& a, const auto& b) { return spare_us(a.second) < spare_us(b.second); });
      if (spare_us(quietest->second) < 0) return nullptr;
      for (StreamState& stream : quietest->second.streams) {
        while (!stream.open.empty()) GiveUp(quietest->second, stream, stream.open.begin(), now_us);
      }
      sources_.erase(quietest);
    }
    found = sources_.emplace(epoch, Source{}).first;
  }
  found->second.last_heard_us = now_us;
  return &found->second;
}

Reassembler::OpenPictures::iterator Reassembler::OpenNew(Source& source, StreamState& stream,
                                                         const mixstage_lcm::frame_slice_t& slice,
                                                         std::int64_t now_us) {
  const PictureKey key = KeyOf(slice);
  const std::size_t bytes = OpenPicture::MemoryBytes(key);
  if (!source.quota.TakePicture(bytes, now_us)) {
    ++counters_.quota;
    return stream.open.end();
  }
  for (auto it = stream.open.begin(); it != stream.open.end();) {
    const auto old = it++;
    if (!old->second.picture.whole() && source.slices - old->second.touched_at >= kDeadSlices)
      GiveUp(source, stream, old, now_us);
  }
  if (static_cast<int>(stream.open.size()) >= kMaxOpenPictures) {
    if (stream.waiting > 0) {
      DeliverFirstWhole(source, stream, now_us);
    } else {
      GiveUp(source, stream,
             std::min_element(
                 stream.open.begin(), stream.open.end(),
                 [](const auto& a, const auto& b) { return a.second.touched_at < b.second.touched_at; }),
             now_us);
    }
  }
  if (!MakeRoom(source, bytes, now_us)) {
    ++counters_.no_room;
    return stream.open.end();
  }
  if (key.sequence <= stream.finished_up_to) {  // making room has finished what is newer
    ++counters_.late_slice;
    return stream.open.end();
  }
  open_bytes_ += bytes;
  source.open_bytes += bytes;
  return stream.open.emplace(key, Open{OpenPicture(slice), source.slices, now_us, source.slices}).first;
}

bool Reassembler::MakeRoom(Source& source, std::size_t bytes, std::int64_t now_us) {
  while (open_bytes_ + bytes > kMaxOpenBytes) {
    auto use = [&](const Source& s) { return s.open_bytes + (&s == &source ? bytes : 0); };
    Source& largest = std::max_element(sources_.begin(), sources_.end(), [&](const auto& a, const auto& b) {
                        return use(a.second) < use(b.second);
                      })->second;
    StreamState* of = nullptr;
    OpenPictures::iterator oldest;
    for (StreamState& stream : largest.streams) {
      for (auto it = stream.open.begin(); it != stream.open.end(); ++it) {
        if (of != nullptr && it->second.touched_at >= oldest->second.touched_at) continue;
        of = &stream;
        oldest = it;
      }
    }
    if (of == nullptr) return false;
    if (oldest->second.picture.whole()) {
      DeliverFirstWhole(largest, *of, now_us);
    } else {
      GiveUp(largest, *of, oldest, now_us);
    }
  }
  return true;
}

void Reassembler::AddToSettling(Source& source, StreamState& stream,
                                const mixstage_lcm::frame_slice_t& slice) {
  const PictureKey key = KeyOf(slice);
  const auto found = std::find_if(stream.settling.rbegin(), stream.settling.rend(),
                                  [&](const Settling& s) { return s.key == key; });
  if (found == stream.settling.rend()) {
    ++counters_.late_slice;
  } else if (!found->seen.Mark(slice.slice)) {
    ++counters_.duplicate_slice;
  } else {
    ++(found->delivered ? counters_.spare_slice : counters_.late_slice);
    ++source.slices;
    ReleaseAll(source, source.last_heard_us);
  }
}

void Reassembler::ReleaseAll(Source& source, std::int64_t now_us) {
  for (StreamState& stream : source.streams) {
    if (stream.waiting > 0) Release(source, stream, now_us);
  }
}

void Reassembler::Release(Source& source, StreamState& stream, std::int64_t now_us) {
  while (stream.waiting > 0) {
    const auto whole = std::find_if(stream.open.begin(), stream.open.end(),
                                    [](const auto& o) { return o.second.picture.whole(); });
    const bool in_order = whole->first.sequence == stream.finished_up_to + 1;
    const bool waited = source.slices - whole->second.opened_at >= kReorderSlices ||
                        now_us - whole->second.opened_us >= kReorderWaitUs;
    if (!in_order && !waited) return;
    DeliverFirstWhole(source, stream, now_us);
  }
}

void Reassembler::DeliverFirstWhole(Source& source, StreamState& stream, std::int64_t now_us) {
  const auto whole = std::find_if(stream.open.begin(), stream.open.end(),
                                  [](const auto& o) { return o.second.picture.whole(); });
  MIX_CHECK(whole != stream.open.end());
  const PictureKey key = whole->first;
  counters_.repaired += whole->second.picture.repaired();
  source.repaired += whole->second.picture.repaired();
  source.proven = true;
  ready_.push_back(whole->second.picture.Take());
  ++counters_.frames;
  Settle(source, stream, key, whole->second.picture, now_us);
  stream.settling.back().delivered = true;
  --stream.waiting;
  stream.open.erase(whole);
  // What is older can no longer be shown in order, and of pictures with one number one is true.
  while (!stream.open.empty() && stream.open.begin()->first.sequence <= key.sequence) {
    const auto old = stream.open.begin();
    if (old->first.sequence < key.sequence) {
      GiveUp(source, stream, old, now_us);
      continue;
    }
    counters_.bad_slice += old->second.picture.seen().count();
    stream.waiting -= old->second.picture.whole();
    open_bytes_ -= OpenPicture::MemoryBytes(old->first);
    source.open_bytes -= OpenPicture::MemoryBytes(old->first);
    stream.open.erase(old);
  }
  stream.finished_up_to = key.sequence;
  stream.finished_us = now_us;
}

void Reassembler::GiveUp(Source& source, StreamState& stream, OpenPictures::iterator picture,
                         std::int64_t now_us) {
  ++(picture->second.picture.damaged() ? counters_.crc : counters_.incomplete);
  stream.waiting -= picture->second.picture.whole();
  Settle(source, stream, picture->first, picture->second.picture, now_us);
  stream.open.erase(picture);
}

void Reassembler::Settle(Source& source, StreamState& stream, const PictureKey& key,
                         const OpenPicture& picture, std::int64_t now_us) {
  open_bytes_ -= OpenPicture::MemoryBytes(key);
  source.open_bytes -= OpenPicture::MemoryBytes(key);
  stream.settling.push_back({key, picture.seen(), false, source.slices, now_us});
  SettleOld(source, stream, now_us);
}

void Reassembler::SettleOld(Source& source, StreamState& stream, std::int64_t now_us) {
  while (!stream.settling.empty()) {
    const Settling& oldest = stream.settling.front();
    const bool done = source.slices - oldest.at >= kSettleSlices || now_us - oldest.at_us >= kSettleUs ||
                      stream.settling.size() > kMaxSettling;
    if (!done) return;
    source.loss.Settle(oldest.seen.expected(), oldest.seen.count(), now_us);
    stream.settling.pop_front();
  }
}

}  // namespace mixstage
