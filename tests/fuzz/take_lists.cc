// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "proto/take/take.h"
#include "tests/fuzz/temp_folder.h"

namespace {

namespace fs = std::filesystem;

// A take whose lists the fuzzer writes.
struct TakeFolder : mixstage::TempFolder {
  TakeFolder() {
    fs::create_directories(place / "rgb");
    for (const char* name : {"rgb/a.jpg", "rgb/b.jpg"}) Write(name, std::array<std::uint8_t, 1>{'x'});
  }
};

}  // namespace

// The first byte says which list the others are. Times rise, pictures lie inside the folder.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static const TakeFolder folder;
  if (size < 1) return 0;
  constexpr const char* kNames[] = {"rgb.txt", "depth.txt", "ptu.txt", "groundtruth.txt"};
  const std::size_t which = data[0] % 4;
  if (which != 0) std::ofstream(folder.place / "rgb.txt") << "1.0 rgb/a.jpg\n2.0 rgb/b.jpg\n";
  folder.Write(kNames[which], {data + 1, size - 1});
  const auto poses = ReadPoses(folder.place / "groundtruth.txt");
  const auto take = OpenTake(folder.place);
  fs::remove(folder.place / kNames[which]);
  for (std::size_t i = 1; poses && i < poses->size(); ++i) MIX_CHECK((*poses)[i].t_s > (*poses)[i - 1].t_s);
  if (!take) return 0;
  MIX_CHECK(!take->color.empty());
  const std::string inside = fs::canonical(folder.place).string() + "/";
  for (const auto* entries : {&take->color, &take->depth}) {
    for (const TakeEntry& entry : *entries) {
      // As the system opens it: up to the first zero byte.
      MIX_CHECK(fs::canonical(entry.file.c_str()).string().starts_with(inside));
    }
  }
  return 0;
}
