// SPDX-License-Identifier: Apache-2.0
// A scene for tests: a statue that stands 4 m before the world's origin, and a lamp.
import type { Scene, SceneLight, SceneObject } from '../transport/scene';

export const kStatue: SceneObject = {
  id: 7,
  name: 'statue',
  file: 'statue.glb',
  pose: [1, 0, 0, 4, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
  body: 'mutual',
  triangles: 12,
  bounds: [-0.5, -0.5, 0, 0.5, 0.5, 1],
  base: [4, 0, 0],
  radius_m: 0.7,
  hidden: false,
};

export const kLamp: SceneLight = {
  id: 3,
  name: 'lamp',
  kind: 'area',
  position: [3, 0, 2],
  color: [1, 1, 1],
  intensity: 1,
};

export const kScene: Scene = {
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
  models: ['vase.glb'],
};
