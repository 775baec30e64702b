// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { metresOfCode } from './depth_code';

const kRange = { near_m: 0.8, far_m: 6 };

describe('a depth code', () => {
  it('is near at 1023, far at 1, nothing at 0', () => {
    expect(metresOfCode(1023, kRange)).toBeCloseTo(0.8, 12);
    expect(metresOfCode(1, kRange)).toBeCloseTo(6, 12);
    expect(metresOfCode(0, kRange)).toBe(0);
  });

  it('is linear in inverse depth', () => {
    expect(1 / metresOfCode(512, kRange)).toBeCloseTo((1 / 0.8 + 1 / 6) / 2, 12);
  });
});
