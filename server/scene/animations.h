// SPDX-License-Identifier: Apache-2.0
//
// What moves the objects of a scene whose files say how (glTF animations). Each plays the animation that the
// scene gives it, again and again from the show's first picture on; another one may be played once between.
// The same pictures' times give the same poses.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>

#include "server/scene/scene.h"

namespace mixstage {

class Animations {
 public:
  // From t_us on the named object plays that clip once. Then its own goes on; one that has none stays as the
  // clip ends, until a person gives it another. Nothing where scene has no such object or clip.
  void PlayOnce(const PlayAnimation& what, std::int64_t t_us, const Scene& scene);

  // Sets SceneObject::posed of every object for the picture at t_us; hidden ones wait.
  void Pose(std::int64_t t_us, Scene& scene);

 private:
  struct Once {
    int clip = 0;
    std::int64_t from_us = 0;
    int usual_clip = 0;  // of the scene, then
  };
  using Key = std::tuple<std::shared_ptr<const MeshMotion>, int, float>;  // clip, second of it

  std::optional<std::int64_t> start_us_;
  std::map<std::uint32_t, Once> once_;  // by the object's id
  // Of the last picture: objects that do the same at the same time share it, and what stands is not posed
  // anew.
  std::map<Key, std::shared_ptr<const PosedVertices>> posed_;
};

}  // namespace mixstage
