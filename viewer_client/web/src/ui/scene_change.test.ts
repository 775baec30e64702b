// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Scene, SceneAvatar, SceneLight, SceneObject } from '../transport/scene';
import { changeOf } from './scene_change';

const kStatue: SceneObject = {
  id: 1,
  name: 'statue',
  file: 'statue.glb',
  pose: [1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
  body: 'mutual',
  triangles: 12,
  bounds: [-1, -1, 0, 1, 1, 2],
  base: [2, 0, 0],
  radius_m: 1,
  hidden: false,
};
const kLamp: SceneLight = {
  id: 1,
  name: 'lamp',
  kind: 'area',
  position: [0, 0, 2],
  color: [1, 1, 1],
  intensity: 1,
};
const kScene: Scene = {
  revision: 1,
  frame: 'world',
  up: [0, 0, 1],
  can_undo: false,
  can_redo: false,
  unsaved: false,
  by: '',
  edits: 0,
  objects: [kStatue],
  lights: [kLamp],
  models: [],
};

const kAvatar: SceneAvatar = { position: [1, 0, 0], turn_deg: 0 };

function withStatue(part: Partial<SceneObject>): Scene {
  return { ...kScene, objects: [{ ...kStatue, ...part }] };
}

describe('a change of the scene', () => {
  it.each([
    [
      'moved statue',
      withStatue({ base: [2, 1, 0], pose: [...kStatue.pose.slice(0, 7), 1, ...kStatue.pose.slice(8)] }),
    ],
    ['turned statue', withStatue({ pose: [0, -1, 0, 2, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] })],
    ['hid statue', withStatue({ hidden: true })],
    ['added vase', { ...kScene, objects: [kStatue, { ...kStatue, id: 2, name: 'vase' }] }],
    ['removed statue', { ...kScene, objects: [] }],
    ['changed lamp', { ...kScene, lights: [{ ...kLamp, intensity: 2 }] }],
    ['moved lamp', { ...kScene, lights: [{ ...kLamp, position: [1, 0, 2] }] }],
    ['turned the actor', { ...kScene, avatar: { position: [1, 0, 0], turn_deg: 30 } }],
    ['changed 2 things', { ...withStatue({ hidden: true }), lights: [{ ...kLamp, intensity: 2 }] }],
    [null, { ...kScene, revision: 2, can_undo: true }],
  ] as [string | null, Scene][])('is said as: %s', (sentence, after) =>
    expect(changeOf({ ...kScene, avatar: kAvatar }, { avatar: kAvatar, ...after, edits: 1 })).toBe(sentence),
  );

  it('knows saving and showing', () => {
    expect(changeOf({ ...kScene, unsaved: true }, kScene)).toBe('saved the scene');
    expect(changeOf(withStatue({ hidden: true }), { ...kScene, edits: 1 })).toBe('showed statue');
  });

  it('is nobody\'s where something falls', () => {
    expect(changeOf(kScene, withStatue({ base: [2, 1, 0] }))).toBeNull();
  });
});
