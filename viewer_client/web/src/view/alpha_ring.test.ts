// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { Plane } from '../decode/depth_picture';
import { AlphaRing, alphaOf } from './alpha_ring';

function plane(values: number[], width: number, stride: number): Plane {
  return { samples: Uint16Array.from(values), stride, width, height: values.length / stride };
}

describe('alpha', () => {
  it('is a quarter of coverage, rounded, cut at 255, without the padding of rows', () => {
    const out = new Uint8Array(4);
    alphaOf(plane([1, 1020, 9, 510, 1023, 9], 2, 3), out);
    expect([...out]).toEqual([0, 255, 128, 255]);
  });
});

describe('AlphaRing', () => {
  it('finds a matte by its own frame only', () => {
    const ring = new AlphaRing(3);
    ring.add(5n, plane([40], 1, 1));
    ring.add(6n, plane([80], 1, 1));
    expect(ring.find(5n)?.samples[0]).toBe(10);
    expect(ring.find(7n)).toBeNull();
  });

  it('forgets the oldest and keeps the others as they were, also when the size changes', () => {
    const ring = new AlphaRing(2);
    ring.add(1n, plane([4], 1, 1));
    ring.add(2n, plane([8], 1, 1));
    ring.add(3n, plane([12, 16], 2, 2));
    expect(ring.find(1n)).toBeNull();
    expect([...(ring.find(2n)?.samples ?? [])]).toEqual([2]);
    expect([...(ring.find(3n)?.samples ?? [])]).toEqual([3, 4]);
  });
});
