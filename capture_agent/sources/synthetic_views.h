// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "proto/synthetic/views.h"

namespace mixstage {

// Records the views of the synthetic set that calibrate and scan take (proto/synthetic/views.h) into a new
// folder in a take's layout (SPEC.md 5), with board.json where there are boards and rig.json: what is known
// of the rig before, nothing of the truth. One view every two seconds of the take's clock; a scan has three
// depth frames each. rig: as in MakeSyntheticSource; a rig that is given is what is known of it, too. Fails
// where a camera is not valid, the folder holds a take or cannot be written.
Status WriteSyntheticViews(SyntheticViews views, const std::optional<Rig>& rig,
                           const std::filesystem::path& folder);

}  // namespace mixstage
