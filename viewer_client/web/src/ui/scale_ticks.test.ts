// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { scalePosition, scaleTicks } from './scale_ticks';

describe('the depth scale', () => {
  it('has far at its top and near at its foot', () => {
    const range = { near_m: 1, far_m: 5 };
    expect([5, 3, 1, 9].map((z_m) => scalePosition(z_m, range))).toEqual([0, 0.5, 1, 0]);
  });

  it.each([
    [0.5, 6.25],
    [1.2, 5],
    [2, 2.3],
    [0.3, 120],
  ])('%f to %f m: round, inside, few, clear of the ends', (near_m, far_m) => {
    const most = 8;
    const ticks = scaleTicks({ near_m, far_m }, most);
    expect(ticks.length).toBeGreaterThan(0);
    expect(ticks.length).toBeLessThanOrEqual(most);
    for (const { z_m } of ticks) {
      expect(Math.min(z_m - near_m, far_m - z_m)).toBeGreaterThanOrEqual((far_m - near_m) / (2 * most));
    }
  });

  it('writes all ticks with the digits of their step', () => {
    expect(scaleTicks({ near_m: 1.2, far_m: 5 }, 8).map(({ text }) => text)).toEqual([
      '1.5',
      '2.0',
      '2.5',
      '3.0',
      '3.5',
      '4.0',
      '4.5',
    ]);
  });
});
