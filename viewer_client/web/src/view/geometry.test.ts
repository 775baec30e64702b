// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Vector3 } from '../transport/scene';
import {
  circle,
  cross,
  dot,
  horizontal,
  kIdentityPose,
  meetPlane,
  project,
  rayThrough,
  sub,
  transform,
  transformBack,
  type Viewpoint,
} from './geometry';

const kPinhole = { width: 640, height: 480, fx: 500, fy: 510, cx: 320, cy: 240 };
// A camera 1.5 m above the floor of a z-up world that looks along +x: its x is -y, its y is -z, its z is +x.
const kPose = [0, 0, 1, 0.5, -1, 0, 0, -0.25, 0, -1, 0, 1.5];
const kView: Viewpoint = { T_scene_camera: kPose, pinhole: kPinhole };

function near(got: Vector3 | null, wanted: Vector3): void {
  if (got === null) throw new Error('nothing');
  got.forEach((value, index) => expect(value).toBeCloseTo(wanted[index] ?? NaN, 9));
}

describe('geometry', () => {
  it('turns a transform back', () => {
    const point: Vector3 = [0.3, -2, 5];
    near(transformBack(kPose, transform(kPose, point)), point);
    near(transform(kIdentityPose, point), point);
  });

  it('projects what is known', () => {
    expect(project(kView, [4.5, -0.25, 1.5])).toEqual({ u: 320, v: 240, z_m: 4 });
    // One metre to the left (+y) and one below, four metres away.
    expect(project(kView, [4.5, 0.75, 0.5])).toEqual({ u: 320 - 125, v: 240 + 127.5, z_m: 4 });
    expect(project(kView, [0.5, 0, 1])).toBeNull();
    expect(project(kView, [-3, 0, 1])).toBeNull();
  });

  it('finds the floor under a pixel and projects back onto it', () => {
    for (const [u, v] of [
      [320, 400],
      [10, 260],
      [639, 479],
    ] as const) {
      const floor = meetPlane(rayThrough(kView, u, v), [0, 0, 1], [0, 0, 0]);
      if (floor === null) throw new Error('no floor');
      expect(floor[2]).toBeCloseTo(0, 9);
      const pixel = project(kView, floor);
      expect(pixel?.u).toBeCloseTo(u, 6);
      expect(pixel?.v).toBeCloseTo(v, 6);
    }
  });

  it('finds no floor at or above the horizon', () => {
    expect(meetPlane(rayThrough(kView, 320, 240), [0, 0, 1], [0, 0, 0])).toBeNull();
    expect(meetPlane(rayThrough(kView, 320, 100), [0, 0, 1], [0, 0, 0])).toBeNull();
  });

  it.each([[[0, 0, 1]], [[0, -1, 0]], [[1, 0, 0]], [[0.6, 0, 0.8]]] as [Vector3][])(
    'spans the plane across %j',
    (up) => {
      const [e0, e1] = horizontal(up);
      expect(dot(e0, up)).toBeCloseTo(0, 9);
      near(cross(e0, e1), up);
      for (const point of circle([1, 2, 3], 0.5, up, 8)) {
        const out = sub(point, [1, 2, 3]);
        expect(Math.hypot(...out)).toBeCloseTo(0.5, 9);
        expect(dot(out, up)).toBeCloseTo(0, 9);
      }
    },
  );
});
