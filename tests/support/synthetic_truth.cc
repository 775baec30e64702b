// SPDX-License-Identifier: Apache-2.0
// Depth of the empty synthetic room at pixels of the colour camera, as JSON:   synthetic_truth U V
// TOLERANCE_M [...]
#include <cstdio>
#include <cstdlib>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"

int main(int argc, char** argv) {
  if (argc < 4 || (argc - 1) % 3 != 0) {
    std::fprintf(stderr, "usage: synthetic_truth U V TOLERANCE_M [...]\n");
    return 2;
  }
  const auto scene = mixstage::SyntheticScene::Create(mixstage::SyntheticRig(), {});
  if (!scene) {
    std::fprintf(stderr, "synthetic_truth: %s\n", scene.error().message.c_str());
    return 1;
  }
  std::printf("[");
  for (int i = 1; i < argc; i += 3) {
    const double u = std::atof(argv[i]);
    const double v = std::atof(argv[i + 1]);
    const auto truth = scene->TruthAt(mixstage::SyntheticCamera::kColor, u, v, 0);
    if (!truth) {
      std::fprintf(stderr, "synthetic_truth: the lens has no ray at %s, %s\n", argv[i], argv[i + 1]);
      return 3;
    }
    std::printf("%s{\"x\": %g, \"y\": %g, \"z_m\": %.4f, \"tolerance_m\": %g}", i == 1 ? "" : ", ", u, v,
                static_cast<double>(truth->depth_m), std::atof(argv[i + 2]));
  }
  std::printf("]\n");
  return 0;
}
