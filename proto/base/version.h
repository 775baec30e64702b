// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace mixstage {

// MIXSTAGE_VERSION is the project's version of the top CMakeLists.txt.
inline constexpr const char* kVersion = MIXSTAGE_VERSION;

}  // namespace mixstage
