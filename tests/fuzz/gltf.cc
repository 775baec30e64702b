// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_file.h"
#include "tests/fuzz/mesh_poses.h"
#include "tests/fuzz/temp_folder.h"

// A mesh that keeps all its promises, or an error; third-party parsers may throw, which LoadModel catches.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static const TempFolder folder;
  const std::vector<std::uint8_t> bytes(data, data + size);
  try {
    const auto model = ImportGltf(bytes, folder.place);
    if (model && CheckMesh(model->mesh)) CheckPoses(model->mesh);
  } catch (const std::exception&) {
  }
  return 0;
}
