// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Viewpoint } from '../view/geometry';
import { ringPath } from './ring_overlay';

const kView: Viewpoint = {
  T_scene_camera: [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 1.5],
  pinhole: { width: 640, height: 480, fx: 500, fy: 500, cx: 320, cy: 240 },
};

function pixelsOf(path: string): [number, number][] {
  return path
    .slice(1, -1)
    .split('L')
    .map((pair) => pair.split(' ').map(Number) as [number, number]);
}

describe('the shadow ring', () => {
  it('lies around the base, flat as the floor is seen', () => {
    const pixels = pixelsOf(ringPath(kView, [5, 0, 0], 0.5, [0, 0, 1]));
    const us = pixels.map(([u]) => u);
    const vs = pixels.map(([, v]) => v);
    // The base is at (320, 390); half a metre at five metres is 50 px, and a little more on the near side.
    expect(Math.min(...us)).toBeGreaterThan(320 - 52);
    expect(Math.min(...us)).toBeLessThan(320 - 49);
    expect(Math.max(...vs)).toBeCloseTo(240 + (500 * 1.5) / 4.5, 0);
    expect(Math.min(...vs)).toBeCloseTo(240 + (500 * 1.5) / 5.5, 0);
  });

  it('is not drawn behind the camera, around it or outside the picture', () => {
    expect(ringPath(kView, [-5, 0, 0], 0.5, [0, 0, 1])).toBe('');
    expect(ringPath(kView, [0.2, 0, 0], 0.5, [0, 0, 1])).toBe('');
    expect(ringPath(kView, [5, 9, 0], 0.5, [0, 0, 1])).toBe('');
  });
});
