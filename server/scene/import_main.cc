// SPDX-License-Identifier: Apache-2.0
//
// mixstage-import: reads one model file of a stranger, confined, and writes it to standard output as
// model_wire.h says. The server starts it (model_process.h); it is of no use to people.
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string_view>

#include "server/scene/confine.h"
#include "server/scene/model_wire.h"

namespace mixstage {
namespace {

template <typename T>
bool Parse(std::string_view text, T& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

bool ToStandardOutput(const void* bytes, std::size_t count) {
  const auto* next = static_cast<const char*>(bytes);
  while (count > 0) {
    const ssize_t n = write(STDOUT_FILENO, next, count);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    next += n;
    count -= static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  using namespace mixstage;
  Confinement confinement;
  if (argc != 4 || !Parse(argv[1], confinement.memory_bytes) || !Parse(argv[2], confinement.cpu_seconds)) {
    std::fputs("usage: mixstage-import MEMORY_BYTES CPU_SECONDS MODEL, started by mixstage-server\n", stderr);
    return 2;
  }
  const std::filesystem::path file = argv[3];
  confinement.readable = file.parent_path();
  cv::setNumThreads(1);
  if (auto ok = ConfineThisProcess(confinement); !ok) {
    return WriteModel(tl::unexpected(ok.error()), ToStandardOutput) ? 0 : 1;
  }
  // The answer is out: to take the model apart would only cost time.
  std::_Exit(WriteModel(LoadModel(file), ToStandardOutput) ? 0 : 1);
}
