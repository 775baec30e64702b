// SPDX-License-Identifier: Apache-2.0
#include "server/physics/reactions.h"

#include <algorithm>
#include <cmath>

namespace mixstage {

void Reactions::SetScene(const Scene& scene, Scene& posed) {
  if (scene.reactions != reactions_) {
    reactions_ = scene.reactions;
    due_.clear();
  }
  objects_.clear();
  if (!reactions_.empty()) objects_ = scene.objects;
  std::erase_if(dimmed_, [&](const auto& dimmed) {
    const auto light = std::ranges::find(posed.lights, dimmed.first, &Light::id);
    if (light == posed.lights.end() || light->intensity != dimmed.second.was) return true;
    light->intensity = dimmed.second.now;
    return false;
  });
}

bool Reactions::Step(std::int64_t t_us, std::vector<PhysicsEvent>& events, const Stage& stage) {
  for (const PhysicsEvent& event : events) {
    if (event.kind != PhysicsEventKind::kTouch) continue;
    for (std::size_t i = 0; i < reactions_.size(); ++i) {
      const Reaction& reaction = reactions_[i];
      if (event.name != reaction.object || event.with != reaction.meets ||
          event.impulse_ns < reaction.least_impulse_ns ||
          std::ranges::find(due_, i, &Due::reaction) != due_.end())
        continue;
      due_.push_back({i, event.t_us + std::llround(1e6 * reaction.after_s), event});
    }
  }
  bool lights_changed = false;
  for (auto due = due_.begin(); due != due_.end();) {
    if (due->t_us > t_us) {
      ++due;
      continue;
    }
    lights_changed |= Do(*due, events, stage);
    due = due_.erase(due);
  }
  return lights_changed;
}

bool Reactions::Do(const Due& due, std::vector<PhysicsEvent>& events, const Stage& stage) {
  const auto& action = reactions_[due.reaction].action;
  if (const auto* message = std::get_if<SendMessage>(&action)) {
    PhysicsEvent said = due.cause;
    said.kind = PhysicsEventKind::kMessage;
    said.t_us = due.t_us;
    said.text = message->text;
    events.push_back(std::move(said));
  } else if (const auto* back = std::get_if<PutBack>(&action)) {
    const auto object = std::ranges::find(objects_, back->object, &SceneObject::name);
    if (object != objects_.end()) stage.physics.PutBack(*object);
  } else if (const auto* play = std::get_if<PlayAnimation>(&action)) {
    stage.animations.PlayOnce(*play, due.t_us, stage.posed);
  } else if (const auto* dim = std::get_if<DimLight>(&action)) {
    std::vector<Light>& lights = stage.posed.lights;
    const auto light = std::ranges::find(lights, dim->light, &Light::name);
    if (light == lights.end() || light->intensity == dim->intensity) return false;
    Dimmed& dimmed = dimmed_.try_emplace(light->id, Dimmed{light->intensity, 0}).first->second;
    light->intensity = dimmed.now = dim->intensity;
    return true;
  }
  return false;
}

}  // namespace mixstage
