// SPDX-License-Identifier: Apache-2.0
#include "server/scene/confine.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstring>

namespace mixstage {
namespace {

#if defined(__x86_64__)
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_AARCH64;
#else
constexpr std::uint32_t kArchitecture = 0;  // no filter of system calls; the other limits hold
#endif

Status Refused(const char* what) {
  return Fail(ErrorCode::kInternal, std::string("cannot give up ") + what + ": " + std::strerror(errno));
}

bool Limit(int resource, rlim_t soft, rlim_t hard) {
  const rlimit limit{soft, hard};
  return setrlimit(static_cast<__rlimit_resource>(resource), &limit) == 0;
}

// From Landlock's first version on; what the running kernel does not know is left out.
Status ConfineFiles(const std::filesystem::path& folder) {
  const auto abi = syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (abi < 1) return {};
  constexpr std::uint64_t kRead = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR;
  landlock_ruleset_attr handled{};
  handled.handled_access_fs =
      kRead | LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
      LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR |
      LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO |
      LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM;
  const auto rules = static_cast<int>(syscall(SYS_landlock_create_ruleset, &handled, sizeof handled, 0));
  if (rules < 0) return Refused("files");
  landlock_path_beneath_attr beneath{};
  beneath.allowed_access = kRead;
  beneath.parent_fd = open(folder.empty() ? "." : folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  // A folder that is not there: then nothing may be read, and the importer says what is missing.
  if (beneath.parent_fd >= 0) {
    const auto added = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &beneath, 0);
    close(beneath.parent_fd);
    if (added != 0) return Refused("files");
  }
  const auto done = syscall(SYS_landlock_restrict_self, rules, 0);
  close(rules);
  return done == 0 ? Status() : Refused("files");
}

Status RefuseSystemCalls() {
  if (kArchitecture == 0) return {};
  constexpr std::array<std::uint32_t, 11> kRefused = {
      SYS_socket,           SYS_socketpair, SYS_execve, SYS_execveat,          SYS_ptrace,
      SYS_process_vm_readv, SYS_kill,       SYS_bpf,    SYS_process_vm_writev, SYS_io_uring_setup,
      SYS_perf_event_open};
  std::array<sock_filter, 5 + kRefused.size() + 1> filter{};
  std::size_t n = 0;
  filter[n++] = BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, arch));
  filter[n++] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kArchitecture, 1, 0);
  filter[n++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS);
  filter[n++] = BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr));
  for (std::size_t i = 0; i < kRefused.size(); ++i) {
    const auto to_refusal = static_cast<std::uint8_t>(kRefused.size() - i);
    filter[n++] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kRefused[i], to_refusal, 0);
  }
  filter[n++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
  filter[n++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM);
  sock_fprog program{static_cast<unsigned short>(n), filter.data()};
  // A container may have forbidden filters of its own making: it has one then.
  (void)prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
  return {};
}

}  // namespace

Status ConfineThisProcess(const Confinement& c) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return Refused("new privileges");
  if (!Limit(RLIMIT_CORE, 0, 0) || !Limit(RLIMIT_FSIZE, 0, 0) || !Limit(RLIMIT_NOFILE, 64, 64) ||
      !Limit(RLIMIT_CPU, c.cpu_seconds, c.cpu_seconds + 1)) {
    return Refused("resources");
  }
  if (kLimitsAddressSpace && !Limit(RLIMIT_AS, c.memory_bytes, c.memory_bytes)) return Refused("memory");
  if (auto ok = ConfineFiles(c.readable); !ok) return ok;
  return RefuseSystemCalls();
}

}  // namespace mixstage
