// SPDX-License-Identifier: Apache-2.0
#include "proto/take/take_recorder.h"

#include <pthread.h>

#include <chrono>
#include <string>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"

namespace mixstage {
namespace {

constexpr std::size_t kMaxWaitingBytes = std::size_t{64} << 20;
constexpr std::size_t kMaxWaitingItems = 4096;  // head angles weigh nothing
constexpr std::chrono::milliseconds kSyncPeriod(500);

std::size_t BytesOf(const TakeContent& content) {
  if (const auto* jpeg = std::get_if<std::vector<std::uint8_t>>(&content)) return jpeg->size();
  if (const auto* counts = std::get_if<cv::Mat1w>(&content)) return counts->total() * counts->elemSize();
  const auto& planes = std::get<YuvImage>(content);
  return planes.y.total() + planes.cb.total() + planes.cr.total();
}

}  // namespace

TakeRecorder::TakeRecorder(TakeWriterConfig config) : config_(std::move(config)) {
  // Without a trailing slash, so that "-2" can be put behind.
  if (!config_.folder.has_filename()) config_.folder = config_.folder.parent_path();
}

TakeRecorder::~TakeRecorder() { Stop(); }

Status TakeRecorder::Start() {
  const std::lock_guard control(control_mutex_);
  if (status().active) return {};
  StopThreads();  // of a take that had to be given up
  TakeWriterConfig config = config_;
  if (takes_ > 0) {
    config.folder += "-";
    config.folder += std::to_string(takes_ + 1);
  }
  auto writer = TakeWriter::Create(config);
  if (!writer) return tl::unexpected(writer.error());
  ++takes_;
  writer_ = std::make_unique<TakeWriter>(std::move(*writer));
  {
    const std::lock_guard lock(mutex_);
    active_ = true;
    failed_ = false;
    pictures_ = dropped_ = 0;
    start_us_ = MonotonicMicros();
  }
  write_thread_ = std::jthread([this] { RunWrite(); });
  sync_thread_ = std::jthread([this](const std::stop_token& stop) { RunSync(stop); });
  spdlog::info("record start folder={}", writer_->folder().string());
  return {};
}

void TakeRecorder::Stop() {
  const std::lock_guard control(control_mutex_);
  if (!writer_) return;
  const bool was_active = status().active;
  StopThreads();
  if (was_active) {
    if (auto ok = writer_->Sync(); !ok) spdlog::error("record reason=\"{}\"", ok.error().message);
    const RecordingStatus s = status();
    spdlog::info("record end folder={} seconds={:.1f} pictures={} dropped={}", writer_->folder().string(),
                 s.seconds, s.pictures, s.dropped);
  }
  writer_.reset();
}

// Called with control_mutex_ held. What waits is written first.
void TakeRecorder::StopThreads() {
  {
    const std::lock_guard lock(mutex_);
    if (active_) end_us_ = MonotonicMicros();
    active_ = false;
  }
  ready_.notify_all();
  if (write_thread_.joinable()) write_thread_.join();
  sync_thread_.request_stop();
  if (sync_thread_.joinable()) sync_thread_.join();
}

void TakeRecorder::Picture(TakeList list, std::int64_t t_us, TakeContent content) {
  const std::size_t bytes = BytesOf(content);
  Push({.t_us = t_us, .list = list, .what = std::move(content), .bytes = bytes});
}

void TakeRecorder::Head(std::int64_t t_us, double pan_deg, double tilt_deg) {
  Push({.t_us = t_us, .what = HeadAngles{pan_deg, tilt_deg}});
}

void TakeRecorder::Push(Item item) {
  {
    const std::lock_guard lock(mutex_);
    if (!active_) return;
    waiting_bytes_ += item.bytes;
    waiting_.push_back(std::move(item));
    while (waiting_.size() > 1 && (waiting_bytes_ > kMaxWaitingBytes || waiting_.size() > kMaxWaitingItems)) {
      waiting_bytes_ -= waiting_.front().bytes;
      waiting_.pop_front();
      ++dropped_;
    }
  }
  ready_.notify_one();
}

// Waits; nothing once the recording was stopped and all is taken.
std::optional<TakeRecorder::Item> TakeRecorder::Pop() {
  std::unique_lock lock(mutex_);
  ready_.wait(lock, [&] { return !waiting_.empty() || !active_; });
  if (waiting_.empty()) return std::nullopt;
  std::optional<Item> item(std::move(waiting_.front()));
  waiting_.pop_front();
  waiting_bytes_ -= item->bytes;
  return item;
}

void TakeRecorder::RunWrite() {
  pthread_setname_np(pthread_self(), "take_write");
  while (const auto item = Pop()) {
    const auto* angles = std::get_if<HeadAngles>(&item->what);
    const Result<TakeWrite> written =
        angles != nullptr ? writer_->WriteHead(item->t_us, angles->pan_deg, angles->tilt_deg)
                          : writer_->WritePicture(item->list, item->t_us, std::get<TakeContent>(item->what));
    if (!written) GiveUp(written.error());
    const std::lock_guard lock(mutex_);
    if (!written || *written == TakeWrite::kLeftOut) {
      ++dropped_;
    } else if (angles == nullptr) {
      ++pictures_;
    }
  }
}

// Beside the writing: a sync that takes long delays no picture's way into its file.
void TakeRecorder::RunSync(const std::stop_token& stop) {
  pthread_setname_np(pthread_self(), "take_sync");
  while (true) {
    {
      std::unique_lock lock(mutex_);
      sync_wake_.wait_for(lock, stop, kSyncPeriod, [] { return false; });
    }
    if (stop.stop_requested()) return;
    if (auto ok = writer_->Sync(); !ok) return GiveUp(ok.error());
  }
}

void TakeRecorder::GiveUp(const Error& error) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(failed_, true)) return;  // said already
    if (active_) end_us_ = MonotonicMicros();
    active_ = false;
    dropped_ += static_cast<std::int64_t>(waiting_.size());
    waiting_.clear();
    waiting_bytes_ = 0;
  }
  ready_.notify_all();
  spdlog::error("record stopped reason=\"{}\"", error.message);
}

RecordingStatus TakeRecorder::status() const {
  const std::lock_guard lock(mutex_);
  RecordingStatus status{.active = active_, .seconds = 0, .pictures = pictures_, .dropped = dropped_};
  if (start_us_ > 0)
    status.seconds = static_cast<double>((active_ ? MonotonicMicros() : end_us_) - start_us_) * 1e-6;
  return status;
}

}  // namespace mixstage
