// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ctime>

#include <cstdint>

namespace mixstage {

namespace internal {
inline std::int64_t ReadClockMicros(clockid_t id) {
  timespec t{};
  clock_gettime(id, &t);
  return std::int64_t{t.tv_sec} * 1'000'000 + t.tv_nsec / 1000;
}
}  // namespace internal

// Microseconds of this machine's monotonic clock: the time base of every `_us` on the wire (an agent's own)
// and, in the server, of every time after ingest has mapped it.
inline std::int64_t MonotonicMicros() { return internal::ReadClockMicros(CLOCK_MONOTONIC); }
// CPU time (user + system) of the calling thread, of the whole process.
inline std::int64_t ThreadCpuMicros() { return internal::ReadClockMicros(CLOCK_THREAD_CPUTIME_ID); }
inline std::int64_t ProcessCpuMicros() { return internal::ReadClockMicros(CLOCK_PROCESS_CPUTIME_ID); }

}  // namespace mixstage
