// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { depthColor, depthPalette } from './depth_palette';
import { paintDepth } from './depth_view';
import { pixelWord, turbo } from './turbo';

const kRange = { near_m: 1, far_m: 5 };

describe('the depth map', () => {
  it('is warm near, cold far, linear in metres between', () => {
    expect(depthColor(1, kRange)).toEqual(turbo(1));
    expect(depthColor(5, kRange)).toEqual(turbo(0));
    expect(depthColor(3, kRange)).toEqual(turbo(0.5));
  });

  it('shows what is not known as grey', () => {
    expect(depthPalette(kRange)[0]).toBe(pixelWord(0x20, 0x20, 0x20));
  });

  it.each([1, 2])('draws every sample in its place, step %i, odd size, padded rows', (step) => {
    const palette = Uint32Array.from({ length: 1024 }, (_, code) => 7 * code);
    const [width, height, stride] = [5, 3, 8];
    const samples = Uint16Array.from({ length: stride * height }, (_, index) => index);
    const out = new Uint32Array(Math.ceil(width / step) * Math.ceil(height / step));
    paintDepth({ samples, stride, width, height }, palette, step, out);
    const wanted: number[] = [];
    for (let y = 0; y < height; y += step)
      for (let x = 0; x < width; x += step) wanted.push(7 * (y * stride + x));
    expect([...out]).toEqual(wanted);
  });
});
