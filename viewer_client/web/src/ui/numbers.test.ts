// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { count, fixed, metres, span } from './numbers';

describe('numbers', () => {
  it('are never NaN or null on the page', () => {
    expect([fixed(null, 1), fixed(NaN, 1), fixed(Infinity, 0), fixed(29.97, 1)]).toEqual([
      '–',
      '–',
      '–',
      '30.0',
    ]);
    expect([metres(null), metres(2.306)]).toEqual(['no depth', '2.31 m']);
  });

  it('are said as a person says them', () => {
    expect([0.9, 3.9, 60, 3599, 7200].map(span)).toEqual(['0 s', '3 s', '1 min', '59 min', '2 h']);
    expect(count(1234567)).toBe('1,234,567');
  });
});
