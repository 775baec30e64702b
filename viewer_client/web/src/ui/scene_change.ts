// SPDX-License-Identifier: Apache-2.0
import type { Scene, SceneLight, SceneObject } from '../transport/scene';

function differs(a: readonly number[] | null, b: readonly number[] | null): boolean {
  return JSON.stringify(a) !== JSON.stringify(b);
}

function ofObject(before: SceneObject, after: SceneObject): string | null {
  if (before.hidden !== after.hidden) return `${after.hidden ? 'hid' : 'showed'} ${after.name}`;
  // The base stays where it is while an object turns about it.
  const far = Math.hypot(...after.base.map((value, axis) => value - (before.base[axis] ?? 0))) > 1e-3;
  if (far) return `moved ${after.name}`;
  return differs(before.pose, after.pose) ? `turned ${after.name}` : null;
}

function ofLight(before: SceneLight, after: SceneLight): string | null {
  const changed = differs(before.color, after.color) || before.intensity !== after.intensity;
  if (changed) return `changed ${after.name}`;
  return differs(before.position, after.position) ? `moved ${after.name}` : null;
}

/** What was done between two scenes, as the end of a sentence: "moved statue"; null when nobody did anything that is seen. */
export function changeOf(before: Scene, after: Scene): string | null {
  const saved = before.unsaved && !after.unsaved ? 'saved the scene' : null;
  // What falls is not done by anybody.
  if (after.edits === before.edits) return saved;
  const done: string[] = [];
  const olds = new Map(before.objects.map((object) => [object.id, object]));
  for (const object of after.objects) {
    const old = olds.get(object.id);
    olds.delete(object.id);
    const change = old === undefined ? `added ${object.name}` : ofObject(old, object);
    if (change !== null) done.push(change);
  }
  for (const gone of olds.values()) done.push(`removed ${gone.name}`);
  for (const light of after.lights) {
    const old = before.lights.find(({ id }) => id === light.id);
    const change = old === undefined ? null : ofLight(old, light);
    if (change !== null) done.push(change);
  }
  const [was, is] = [before.avatar, after.avatar];
  if (was !== undefined && is !== undefined) {
    if (differs(was.position, is.position)) done.push('moved the actor');
    else if (was.turn_deg !== is.turn_deg) done.push('turned the actor');
  }
  const adopted = (after.adopted ?? 0) - (before.adopted ?? 0);
  if (adopted !== 0) done.push(adopted > 0 ? 'made a thing part of the room' : 'forgot things of the room');
  if (done.length === 0) return saved;
  return done.length === 1 ? (done[0] ?? null) : `changed ${done.length} things`;
}
