// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>
#include <variant>

#include "proto/base/result.h"
#include "proto/take/take_writer.h"

namespace mixstage {

struct RecordingStatus {
  bool active = false;
  double seconds = 0;         // length of the running take, or of the last
  std::int64_t pictures = 0;  // written into it
  std::int64_t dropped = 0;   // not written: the disk was too slow, or the writer left it out
};

// Records what a live source gives, start and stop at any time. Whoever hands in pictures never waits: a
// queue of at most 64 MiB stands before the writing thread, and its oldest go when the disk does not keep up.
// A second thread syncs every half second: a power cut or a kill costs at most the last second. When nothing
// more can be written (disk full) that is logged in one line and the recording stops.
class TakeRecorder {
 public:
  // Records into config.folder; every later take of the same recorder beside it: FOLDER-2, FOLDER-3, ...
  explicit TakeRecorder(TakeWriterConfig config);
  ~TakeRecorder();  // stops
  TakeRecorder(const TakeRecorder&) = delete;
  TakeRecorder& operator=(const TakeRecorder&) = delete;

  // Fails (kInvalidConfig) where the folder holds a take already or cannot be made. Does nothing while a
  // recording runs.
  Status Start();
  // Writes what waits, syncs and ends the take. Does nothing where none runs.
  void Stop();

  // Any thread; nothing happens while no recording runs. t_us: any clock that all pictures share; in each
  // list only rising times are written.
  void Picture(TakeList list, std::int64_t t_us, TakeContent content);
  void Head(std::int64_t t_us, double pan_deg, double tilt_deg);

  [[nodiscard]] RecordingStatus status() const;

 private:
  struct HeadAngles {
    double pan_deg = 0, tilt_deg = 0;
  };
  struct Item {
    std::int64_t t_us = 0;
    TakeList list = TakeList::kColor;  // of a picture
    std::variant<TakeContent, HeadAngles> what{};
    std::size_t bytes = 0;
  };
  void Push(Item item);
  std::optional<Item> Pop();
  void RunWrite();
  void RunSync(const std::stop_token& stop);
  void GiveUp(const Error& error);
  void StopThreads();

  TakeWriterConfig config_;

  std::mutex control_mutex_;  // held by Start and Stop; guards what follows
  int takes_ = 0;
  std::unique_ptr<TakeWriter> writer_;  // used by the threads while they run
  std::jthread write_thread_, sync_thread_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable ready_;
  std::condition_variable_any sync_wake_;
  std::deque<Item> waiting_;
  std::size_t waiting_bytes_ = 0;
  bool active_ = false;  // pictures are taken; false also after a failure
  bool failed_ = false;
  std::int64_t start_us_ = 0, end_us_ = 0, pictures_ = 0, dropped_ = 0;
};

}  // namespace mixstage
