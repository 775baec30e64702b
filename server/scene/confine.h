// SPDX-License-Identifier: Apache-2.0
//
// What a process gives up before it reads a stranger's file.
#pragma once

#include <cstdint>
#include <filesystem>

#include "proto/base/result.h"

namespace mixstage {

// False under AddressSanitizer, which maps terabytes.
#if defined(__has_feature)
#if __has_feature(address_sanitizer)
inline constexpr bool kLimitsAddressSpace = false;
#else
inline constexpr bool kLimitsAddressSpace = true;
#endif
#else
inline constexpr bool kLimitsAddressSpace = true;
#endif

struct Confinement {
  std::uint64_t memory_bytes = 0;    // of address space
  unsigned cpu_seconds = 0;          // then SIGXCPU, a second later SIGKILL
  std::filesystem::path readable{};  // a folder; nothing else can be opened, nothing at all written
};

// For the rest of this process's life: the limits above, no core dump, no file written, no new privileges, no
// socket, no other program; it dies with its parent. Reading is confined to the folder where the kernel has
// Landlock (5.13 and later); the importers' own checks of paths hold everywhere.
Status ConfineThisProcess(const Confinement& confinement);

}  // namespace mixstage
