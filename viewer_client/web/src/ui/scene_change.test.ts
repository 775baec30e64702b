// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Scene, SceneAvatar, SceneObject } from '../transport/scene';
import { changeOf } from './scene_change';
import { kLamp, kScene, kStatue } from './scene_fixture';

const kAvatar: SceneAvatar = { position: [1, 0, 0], turn_deg: 0 };

function withStatue(part: Partial<SceneObject>): Scene {
  return { ...kScene, objects: [{ ...kStatue, ...part }] };
}

describe('a change of the scene', () => {
  it.each([
    [
      'moved statue',
      withStatue({ base: [4, 1, 0], pose: [...kStatue.pose.slice(0, 7), 1, ...kStatue.pose.slice(8)] }),
    ],
    ['turned statue', withStatue({ pose: [0, -1, 0, 4, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] })],
    ['hid statue', withStatue({ hidden: true })],
    ['added vase', { ...kScene, objects: [kStatue, { ...kStatue, id: 8, name: 'vase' }] }],
    ['removed statue', { ...kScene, objects: [] }],
    ['changed lamp', { ...kScene, lights: [{ ...kLamp, intensity: 2 }] }],
    ['moved lamp', { ...kScene, lights: [{ ...kLamp, position: [1, 0, 2] }] }],
    ['turned the actor', { ...kScene, avatar: { position: [1, 0, 0], turn_deg: 30 } }],
    ['made a thing part of the room', { ...kScene, adopted: 1 }],
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
    expect(changeOf(kScene, withStatue({ base: [4, 1, 0] }))).toBeNull();
  });
});
