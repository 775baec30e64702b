// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { hexOfLinear, intensityAt, kSliderSteps, linearOfHex, sliderAt } from './light_values';

describe('a light on the page', () => {
  it('is off at the left, 1000 at the right, and rises all the way', () => {
    expect(intensityAt(0)).toBe(0);
    expect(intensityAt(kSliderSteps)).toBe(1000);
    for (let step = 1; step <= kSliderSteps; ++step)
      expect(intensityAt(step)).toBeGreaterThan(intensityAt(step - 1));
  });

  it('keeps its place when the server repeats what was sent', () => {
    for (let step = 0; step <= kSliderSteps; ++step) expect(sliderAt(intensityAt(step))).toBe(step);
  });

  it('shows linear light as sRGB and reads it back', () => {
    expect(hexOfLinear([1, 0, 0.2158605])).toBe('#ff0080');
    expect(linearOfHex('#ff0080')).toEqual([1, 0, 0.2159]);
    for (const hex of ['#000000', '#123456', '#fedcba', '#ffffff'])
      expect(hexOfLinear(linearOfHex(hex))).toBe(hex);
    expect(linearOfHex('nothing')).toEqual([0, 0, 0]);
  });
});
