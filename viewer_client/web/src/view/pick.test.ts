// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { SceneObject } from '../transport/scene';
import type { Viewpoint } from './geometry';
import { heightOf, middleOf, pickObject } from './pick';

const kView: Viewpoint = {
  T_scene_camera: [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 1],
  pinhole: { width: 640, height: 480, fx: 500, fy: 500, cx: 320, cy: 240 },
};

/** A box of 1 x 1 x 2 m that stands on the floor at x, y. */
function box(id: number, x: number, y: number, hidden = false): SceneObject {
  return {
    id,
    name: `box ${id}`,
    file: 'box.glb',
    pose: [1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, 0, 0, 0, 0, 1],
    body: 'mutual',
    triangles: 12,
    bounds: [-0.5, -0.5, 0, 0.5, 0.5, 2],
    base: [x, y, 0],
    radius_m: 0.7,
    hidden,
  };
}

describe('picking', () => {
  it('takes the nearer of two boxes on one pixel', () => {
    const far = box(1, 6, 0);
    const near = box(2, 4, 0);
    expect(pickObject([far, near], kView, 320, 240)?.id).toBe(2);
    expect(pickObject([near, far], kView, 320, 240)?.id).toBe(2);
  });

  it('takes the one beside when the click is beside', () => {
    // Left is +y: at 4.5 m one metre is 111 px.
    expect(pickObject([box(1, 5, 0), box(2, 5, 1.5)], kView, 320 - 165, 240)?.id).toBe(2);
    expect(pickObject([box(1, 5, 0), box(2, 5, 1.5)], kView, 500, 240)).toBeNull();
  });

  it('reaches a little beyond the box and no further', () => {
    const right_px = 320 + (0.5 / 4.5) * 500;
    expect(pickObject([box(1, 5, 0)], kView, right_px + 6, 240)?.id).toBe(1);
    expect(pickObject([box(1, 5, 0)], kView, right_px + 12, 240)).toBeNull();
  });

  it('leaves alone what is hidden, behind the camera or around it', () => {
    expect(pickObject([box(1, 5, 0, true)], kView, 320, 240)).toBeNull();
    expect(pickObject([box(1, -5, 0)], kView, 320, 240)).toBeNull();
    expect(pickObject([box(1, 0.2, 0)], kView, 320, 240)).toBeNull();
  });

  it('measures along up', () => {
    expect(heightOf(box(1, 5, 0), [0, 0, 1])).toBe(2);
    expect(middleOf(box(1, 5, 0), [0, 0, 1])).toEqual([5, 0, 1]);
  });
});
