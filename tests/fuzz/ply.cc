// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto model = ImportPly({data, data + size});
  if (model) (void)CheckMesh(model->mesh);
  return 0;
}
