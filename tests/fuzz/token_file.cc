// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/token_store.h"
#include "tests/fuzz/temp_folder.h"

// A token file that is accepted names every token once.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  static const TempFolder folder;
  folder.Write("tokens.json", {data, size});
  std::filesystem::permissions(folder.place / "tokens.json", std::filesystem::perms(0600));
  const auto store = TokenStore::Load(folder.place / "tokens.json");
  if (!store) return 0;
  for (const Token& token : store->tokens()) {
    MIX_CHECK(store->Holds({.name = token.name, .role = token.role, .token_sha256 = token.sha256}));
    MIX_CHECK(!token.name.empty() && token.name.size() <= 64);
  }
  return 0;
}
