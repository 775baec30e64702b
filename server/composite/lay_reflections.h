// SPDX-License-Identifier: Apache-2.0
//
// Mirrored pictures laid on the room's own surfaces and on patches (MixIn3D 3.3).
#pragma once

#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "proto/codec/yuv_image.h"
#include "server/render/cg_renderer.h"
#include "server/render/light_map.h"
#include "server/render/reflections.h"

namespace mixstage {

// Adds to the picture, which the light map was laid on, where the room's surface mirrors and the actor leaves
// it to be seen. A shadow darkens what a surface scatters, not what it mirrors: of what was mirrored before,
// the share that the light map took is given back. alpha [h x w] as ZKeyInput's. Everything else stays as it
// is.
void ReflectInPicture(const ReflectionPictures& pictures, const LightMap& map,
                      ImageView<const std::uint8_t> alpha, YuvImage& lit);

// Adds to the layer's patches. False: there are none, and nothing was done.
bool ReflectInLayer(const ReflectionPictures& pictures, const CgLayer& layer, CgLayer& reflecting);

}  // namespace mixstage
