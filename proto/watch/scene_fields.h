// SPDX-License-Identifier: Apache-2.0
//
// The messages of scene_message.h out of JSON that has been parsed. Private to proto/watch.
#pragma once

#include "proto/watch/json_field.h"
#include "proto/watch/scene_message.h"

namespace mixstage {

Result<WatchScene> ReadScene(const JsonFields& fields);
Result<WatchRefused> ReadRefused(const JsonFields& fields);
Result<WatchEdit> ReadEdit(const JsonFields& fields);

}  // namespace mixstage
