// SPDX-License-Identifier: Apache-2.0
#include "server/scene/confine.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <fstream>

#include "tests/server/scene/test_models.h"

namespace mixstage {
namespace {

// In a process of its own, which ends with the number of the first thing that went otherwise than it should.
void ConfineAndTry(const std::filesystem::path& folder) {
  if (!ConfineThisProcess({.memory_bytes = std::uint64_t{2} << 30, .cpu_seconds = 5, .readable = folder}))
    _exit(1);
  if (open((folder / "inside").c_str(), O_RDONLY) < 0) _exit(2);
  if (socket(AF_INET, SOCK_STREAM, 0) >= 0) _exit(3);
  if (execl("/bin/true", "true", nullptr) != -1) _exit(4);
  std::ofstream file(folder / "new");
  if (file << "written" && file.flush()) _exit(5);
  // Landlock is the kernel's to have: without it the importers' own checks of names stand alone.
  if (syscall(SYS_landlock_create_ruleset, nullptr, 0, 1u) >= 1 && open("/etc/passwd", O_RDONLY) >= 0)
    _exit(6);
  _exit(0);
}

TEST(Confine, OnlyTheFolderCanBeReadAndNothingElseDone) {
  const test::TemporaryFolder folder;
  folder.Write("inside", "x");
  EXPECT_EXIT(ConfineAndTry(folder.path()), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace mixstage
