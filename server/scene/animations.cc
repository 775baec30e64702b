// SPDX-License-Identifier: Apache-2.0
#include "server/scene/animations.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mixstage {

void Animations::PlayOnce(const PlayAnimation& what, std::int64_t t_us, const Scene& scene) {
  const auto object = std::ranges::find(scene.objects, what.object, &SceneObject::name);
  if (object == scene.objects.end() || object->mesh->motion == nullptr) return;
  const auto clip = FindClip(*object->mesh->motion, what.clip);
  if (clip) once_[object->id] = {*clip, t_us, object->clip};
}

void Animations::Pose(std::int64_t t_us, Scene& scene) {
  if (!start_us_) start_us_ = t_us;
  std::map<Key, std::shared_ptr<const PosedVertices>> now;
  std::map<std::uint32_t, Once> once;
  for (SceneObject& object : scene.objects) {
    const std::shared_ptr<const MeshMotion>& motion = object.mesh->motion;
    if (motion == nullptr) continue;
    int clip = object.clip;
    double t_s = static_cast<double>(t_us - *start_us_) * 1e-6;
    const auto duration_s = [&] {
      return static_cast<double>(motion->clips[static_cast<std::size_t>(clip)].duration_s);
    };
    bool again = true;
    if (const auto found = once_.find(object.id); found != once_.end() && found->second.usual_clip == clip) {
      const Once& playing = found->second;
      const double since_s = static_cast<double>(t_us - playing.from_us) * 1e-6;
      const int usual = std::exchange(clip, playing.clip);
      if (clip >= 0 && (usual < 0 || since_s < duration_s())) {
        once.insert(*found);
        t_s = since_s;
        again = false;
      } else {
        clip = usual;
      }
    }
    object.posed = nullptr;
    if (clip < 0 || object.hidden) continue;
    if (again) t_s = duration_s() > 0 ? t_s - duration_s() * std::floor(t_s / duration_s()) : 0;
    const auto t = static_cast<float>(std::clamp(t_s, 0.0, duration_s()));
    const Key key{motion, clip, t};
    std::shared_ptr<const PosedVertices>& posed = now[key];
    if (const auto known = posed_.find(key); posed == nullptr && known != posed_.end()) posed = known->second;
    if (posed == nullptr) posed = std::make_shared<const PosedVertices>(PoseMesh(*motion, clip, t));
    object.posed = posed;
  }
  once_ = std::move(once);
  posed_ = std::move(now);
}

}  // namespace mixstage
