// SPDX-License-Identifier: Apache-2.0
// Writes a capture folder of the synthetic set with its truth, seen by RIG_FILE or the demonstration's rig:
//   make_synthetic_take FOLDER [BEGIN_S END_S [RIG_FILE]]
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "tests/support/synthetic_take.h"

int main(int argc, char** argv) {
  if (argc < 2 || argc == 3 || argc > 5 || argv[1][0] == '-') {
    std::fprintf(stderr, "usage: make_synthetic_take FOLDER [BEGIN_S END_S [RIG_FILE]]\n");
    return 2;
  }
  mixstage::SyntheticTakeConfig config;
  std::filesystem::path rig_file = std::filesystem::path(MIXSTAGE_SOURCE_DIR) / "deploy/demo/rig.json";
  if (argc >= 4) {
    config.begin_s = std::atof(argv[2]);
    config.end_s = std::atof(argv[3]);
  }
  if (argc == 5) {
    rig_file = argv[4];
    auto rig = mixstage::LoadRig(rig_file);
    if (!rig) {
      std::fprintf(stderr, "make_synthetic_take: %s\n", rig.error().message.c_str());
      return mixstage::ExitCode(rig.error());
    }
    config.rig = rig->rig;
  }
  if (auto ok = mixstage::WriteSyntheticTake(argv[1], config); !ok) {
    std::fprintf(stderr, "make_synthetic_take: %s\n", ok.error().message.c_str());
    return mixstage::ExitCode(ok.error());
  }
  std::error_code error;
  std::filesystem::copy_file(rig_file, std::filesystem::path(argv[1]) / "rig.json",
                             std::filesystem::copy_options::overwrite_existing, error);
  return error ? 1 : 0;
}
