// SPDX-License-Identifier: Apache-2.0
//
// The light map laid on pictures (MixIn3D 3.2): the camera's own and the CG layer.
#pragma once

#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "proto/codec/yuv_image.h"
#include "server/render/cg_renderer.h"
#include "server/render/light_map.h"

namespace mixstage {

// Scales the picture in linear light: the room by map.room, the actor, where he covers the pixel, by
// map.actor. lit becomes a copy that differs inside map.touched only. alpha [h x w] as ZKeyInput's.
void RelightPicture(const LightMap& map, ImageView<const std::uint8_t> alpha, const YuvImage& color,
                    YuvImage& lit);

// lit becomes the layer with its colours scaled by map.cg; depth and ids are shared.
void RelightLayer(const LightMap& map, const CgLayer& layer, CgLayer& lit);

// [h x w] B G R, 255 = 1.0: what RelightPicture scales by. With a step of 2 of every second pixel and row,
// [Half(h) x Half(w)].
[[nodiscard]] cv::Mat3b LightMapPicture(const LightMap& map, ImageView<const std::uint8_t> alpha,
                                        cv::Size size, int step = 1);
// The same for people: as a white surface shows it, sRGB.
[[nodiscard]] cv::Mat3b OnWhite(const cv::Mat3b& light_map);

}  // namespace mixstage
