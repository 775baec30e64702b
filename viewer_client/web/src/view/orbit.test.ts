// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { cross, dot, origin, project, rotate, sub, type Pose } from './geometry';
import { Orbit } from './orbit';

const kCamera: Pose = [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 1.5];
const kWorldUp: [number, number, number] = [0, 0, 1];

function eyeOf(orbit: Orbit): Pose {
  return orbit.viewpoint(400, 300).T_scene_camera;
}

describe('the orbit', () => {
  it.each([[kWorldUp], [[0, -1, 0]]] as [[number, number, number]][])(
    'stands upright with up %j and its axes are a right-handed camera',
    (up) => {
      const orbit = new Orbit();
      orbit.setUp(up);
      orbit.turn(0.7, 0.3);
      const T = eyeOf(orbit);
      const [x, y, z] = [rotate(T, [1, 0, 0]), rotate(T, [0, 1, 0]), rotate(T, [0, 0, 1])];
      expect(dot(x, up)).toBeCloseTo(0, 9);
      expect(dot(y, up)).toBeLessThan(0);
      sub(cross(x, y), z).forEach((error) => expect(error).toBeCloseTo(0, 9));
    },
  );

  it('keeps what it is centred on in the middle, however it turns and zooms', () => {
    const orbit = new Orbit();
    orbit.centre([1, 2, 0.5]);
    for (const [yaw, pitch, zoom] of [
      [1, 0.4, 0.5],
      [-3, -5, 4],
      [0.1, 9, 1000],
      [0, 0, 1e-9],
    ] as const) {
      orbit.turn(yaw, pitch);
      orbit.zoom(zoom);
      const pixel = project(orbit.viewpoint(400, 300), [1, 2, 0.5]);
      expect(pixel?.u).toBeCloseTo(199.5, 6);
      expect(pixel?.v).toBeCloseTo(149.5, 6);
    }
  });

  it('sees what the camera sees at the first pose, from behind it', () => {
    const orbit = new Orbit();
    orbit.setCamera(kCamera);
    expect(origin(eyeOf(orbit))[0]).toBeLessThan(0);
    expect(project(orbit.viewpoint(400, 300), [3, 0, 1])).not.toBeNull();
  });

  it('goes along with a camera that it follows, until it is moved by hand', () => {
    const orbit = new Orbit();
    orbit.setCamera(kCamera);
    orbit.toggleFollow();
    const before = origin(eyeOf(orbit));
    const moved = [...kCamera];
    moved[7] = 1;
    orbit.setCamera(moved);
    sub(origin(eyeOf(orbit)), before).forEach((step, axis) =>
      expect(step).toBeCloseTo(axis === 1 ? 1 : 0, 9),
    );
    orbit.pan(0.1, 0);
    expect(orbit.follows).toBe(false);
  });

  it('pans by what the hand moved', () => {
    const orbit = new Orbit();
    orbit.centre([0, 0, 0]);
    orbit.pan(0.25, 0);
    expect(project(orbit.viewpoint(400, 300), [0, 0, 0])?.u).toBeCloseTo(199.5 + 75, 6);
  });
});
