// SPDX-License-Identifier: Apache-2.0
//
// The light that CG objects are shaded by: lamps and what comes from everywhere (piVE section 4). Levels
// are those of scene/scene.h: 1.0 = the picture's white, in linear light; a matt white surface shows
// irradiance / pi.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "server/render/ambient_light.h"
#include "server/render/room_radiance.h"
#include "server/scene/scene.h"

namespace mixstage {

struct Illumination {
  std::vector<Light> lights;  // scene frame
  AmbientLight ambient;       // scene frame
};

// The scene's lights, else those of the room (null: none was scanned), else a soft key light from above, left
// and in front (world scenes: as seen along the x axis). Ambient: the scene's, else what the room shines onto
// the middle of the objects' places, else what rooms usually scatter.
[[nodiscard]] Illumination IlluminationOf(const Scene& scene, const RoomRadiance* room);
// The key light and the ambient of a scene that has neither lights nor a scanned room.
struct UsualLight {
  Light key;
  Ambient ambient;
};
[[nodiscard]] UsualLight UsualLightOf(SceneFrame frame);

[[nodiscard]] bool SameLight(const Illumination& a, const Illumination& b);

}  // namespace mixstage
