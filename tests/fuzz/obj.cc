// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "server/scene/model_file.h"
#include "tests/fuzz/temp_folder.h"

// The model, and behind a zero byte the materials that it may name as "m.mtl".
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static const TempFolder folder;
  const std::uint8_t* end = std::find(data, data + size, std::uint8_t{0});
  if (end != data + size) folder.Write("m.mtl", {end + 1, data + size});
  try {
    const auto model = ImportObj({data, end}, folder.place);
    if (model) (void)CheckMesh(model->mesh);
  } catch (const std::exception&) {  // of a third party; LoadModel catches it
  }
  return 0;
}
