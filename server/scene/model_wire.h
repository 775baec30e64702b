// SPDX-License-Identifier: Apache-2.0
//
// A model on its way out of the process that imported it. Both ends are of one build: the bytes are the
// machine's own, but the reader believes none of them, because a hostile file may have taken the writer over.
#pragma once

#include <cstddef>
#include <functional>

#include "proto/base/result.h"
#include "server/scene/model_file.h"

namespace mixstage {

// Exactly that many bytes, or false (the other end is gone, time is up).
using WriteBytes = std::function<bool(const void* bytes, std::size_t count)>;
using ReadBytes = std::function<bool(void* bytes, std::size_t count)>;

// What LoadModel answered; false when it could not be written.
[[nodiscard]] bool WriteModel(const Result<LoadedModel>& model, const WriteBytes& write);

// What the importer said: the model or its own refusal. Counts are held against ModelLimits before memory is
// taken, the mesh against CheckMesh. Fails with kInternal when the bytes end early, are none of ours or make
// no good mesh: the importer is not itself any more.
Result<LoadedModel> ReadModel(const ReadBytes& read);

}  // namespace mixstage
