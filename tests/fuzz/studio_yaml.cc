// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "server/app/config.h"

// What was understood is printed as a configuration that means the same.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto config =
      ParseStudioConfig(std::string(reinterpret_cast<const char*>(data), size), "/show/studio.yaml");
  if (!config) return 0;
  const std::string yaml = ToYaml(*config);
  const auto again = ParseStudioConfig(yaml, "/show/studio.yaml");
  MIX_CHECK(again.has_value());
  MIX_CHECK(again->name == config->name && again->lcm_url == config->lcm_url && again->rig == config->rig);
  return 0;
}
