// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { pixelWord, turbo } from './turbo';

describe('turbo', () => {
  it('goes from blue through green to red', () => {
    const [low, middle, high] = [turbo(0.15), turbo(0.5), turbo(0.9)];
    expect(low.blue).toBeGreaterThan(Math.max(low.red, low.green));
    expect(middle.green).toBeGreaterThan(Math.max(middle.red, middle.blue));
    expect(high.red).toBeGreaterThan(Math.max(high.green, high.blue));
  });

  it('has no step that an eye would take for an edge', () => {
    for (let code = 1; code <= 255; ++code) {
      const [a, b] = [turbo((code - 1) / 255), turbo(code / 255)];
      expect(
        Math.max(Math.abs(a.red - b.red), Math.abs(a.green - b.green), Math.abs(a.blue - b.blue)),
        `${code}`,
      ).toBeLessThan(16);
    }
  });

  it('holds its ends', () => {
    expect(turbo(-1)).toEqual(turbo(0));
    expect(turbo(2)).toEqual(turbo(1));
  });

  it('is written as red, green, blue, alpha bytes', () => {
    expect([...new Uint8Array(new Uint32Array([pixelWord(1, 2, 3, 4)]).buffer)]).toEqual([1, 2, 3, 4]);
  });
});
