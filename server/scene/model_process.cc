// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>

#include "proto/base/clock.h"
#include "server/scene/model_wire.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr int kPollMs = 50;
constexpr int kPipeBytes = 1 << 20;

fs::path FindImporter() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const fs::path& place : {folder / "mixstage-import", folder.parent_path() / "mixstage-import"}) {
    if (fs::exists(place, error)) return place;
  }
  return {};
}

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor() { Close(); }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  [[nodiscard]] int get() const { return fd_; }
  void Close() {
    if (fd_ >= 0) close(fd_);
    fd_ = -1;
  }

 private:
  int fd_;
};

enum class Ended { kNot = 1, kLate, kStopped, kExited };

// The child and its answer, read byte by byte until it is whole, time is up or nobody wants it any more.
class Importer {
 public:
  Importer(pid_t pid, int answer_fd, std::int64_t deadline_us, const std::stop_token& stop)
      : pid_(pid), answer_(answer_fd), deadline_us_(deadline_us), stop_(stop) {}
  ~Importer() {
    if (pid_ > 0) Wait(SIGKILL);
  }
  Importer(const Importer&) = delete;
  Importer& operator=(const Importer&) = delete;

  bool Read(void* bytes, std::size_t count) {
    auto* next = static_cast<char*>(bytes);
    while (count > 0) {
      if (stop_.stop_requested()) return End(Ended::kStopped);
      if (MonotonicMicros() >= deadline_us_) return End(Ended::kLate);
      pollfd ready{answer_.get(), POLLIN, 0};
      if (poll(&ready, 1, kPollMs) <= 0) continue;
      const ssize_t n = read(answer_.get(), next, count);
      if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
      if (n <= 0) return End(Ended::kExited);
      next += n;
      count -= static_cast<std::size_t>(n);
    }
    return true;
  }

  // Waits for the end, sending a signal first (0 = none); waitpid's status.
  int Wait(int signal) {
    if (signal != 0) kill(pid_, signal);
    int status = 0;
    while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return status;
  }
  [[nodiscard]] Ended ended() const { return ended_; }

 private:
  bool End(Ended how) {
    ended_ = how;
    return false;
  }

  pid_t pid_;
  FileDescriptor answer_;
  std::int64_t deadline_us_;
  const std::stop_token& stop_;
  Ended ended_ = Ended::kNot;
};

// Nothing of the server goes along: no descriptor (the libraries' sockets among them), no signal mask, no
// environment but where its libraries lie.
Result<pid_t> Start(const fs::path& program, const fs::path& file, const ModelProcessConfig& config,
                    int out) {
  std::string memory = std::to_string(config.memory_bytes);
  std::string seconds = std::to_string(config.seconds);
  std::string path = program.string();
  std::string model = file.string();
  std::array<char*, 5> arguments = {path.data(), memory.data(), seconds.data(), model.data(), nullptr};
  std::string locale = "LC_ALL=C";
  const char* libraries = std::getenv("LD_LIBRARY_PATH");
  std::string library_path =
      libraries != nullptr ? std::string("LD_LIBRARY_PATH=") + libraries : std::string();
  std::array<char*, 3> environment = {locale.data(), library_path.empty() ? nullptr : library_path.data(),
                                      nullptr};

  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_init(&files);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_adddup2(&files, out, STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
  sigset_t none;
  sigset_t all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  pid_t pid = -1;
  const int error =
      posix_spawn(&pid, path.c_str(), &files, &attributes, arguments.data(), environment.data());
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  if (error == 0) return pid;
  return Fail(ErrorCode::kUnavailable, path + " cannot be started: " + std::strerror(error));
}

std::string Gibibytes(std::uint64_t bytes) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.3g GiB", static_cast<double>(bytes) / (1 << 30));
  return text.data();
}

}  // namespace

Result<LoadedModel> LoadModelApart(const fs::path& file, const ModelProcessConfig& config,
                                   const std::stop_token& stop) {
  const fs::path program = config.program.empty() ? FindImporter() : config.program;
  if (program.empty()) {
    return Fail(ErrorCode::kUnavailable,
                "mixstage-import is missing: it belongs beside mixstage-server (run the installer again)");
  }
  const std::int64_t deadline_us = MonotonicMicros() + std::int64_t{config.seconds} * 1'000'000;
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) {
    return Fail(ErrorCode::kUnavailable, file.string() + ": no pipe for its import: " + std::strerror(errno));
  }
  FileDescriptor write_end(ends[1]);
  fcntl(ends[0], F_SETPIPE_SZ, kPipeBytes);
  const Result<pid_t> pid = Start(program, file, config, write_end.get());
  write_end.Close();
  if (!pid) {
    close(ends[0]);
    return tl::unexpected(pid.error());
  }
  Importer importer(*pid, ends[0], deadline_us, stop);
  Result<LoadedModel> model = [&]() -> Result<LoadedModel> {
    try {
      return ReadModel([&](void* bytes, std::size_t count) { return importer.Read(bytes, count); });
    } catch (const std::bad_alloc&) {
      return Fail(ErrorCode::kUnavailable, "");
    }
  }();

  const auto bad = [&](const std::string& what) {
    return Fail(ErrorCode::kBadInput, file.string() + ": " + what);
  };
  const std::string late = "took longer than " + std::to_string(config.seconds) + " s to read";
  switch (importer.ended()) {
    case Ended::kStopped:
      return Fail(ErrorCode::kUnavailable, file.string() + ": its import was stopped");
    case Ended::kLate:
      return bad(late);
    case Ended::kExited: {
      const int status = importer.Wait(0);
      if (!WIFSIGNALED(status)) return bad("ended the importer without an answer");
      const int signal = WTERMSIG(status);
      if (signal == SIGXCPU) return bad(late);
      return bad("crashed the importer (signal " + std::to_string(signal) + ")");
    }
    case Ended::kNot:
      break;
  }
  if (!model && model.error().code == ErrorCode::kUnavailable) {  // LoadModel's word for it
    return bad("needs more than " + Gibibytes(config.memory_bytes) + " of memory");
  }
  if (!model && model.error().code == ErrorCode::kInternal) return bad(model.error().message);
  return model;
}

}  // namespace mixstage
