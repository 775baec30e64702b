// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { labelOf } from './depth_picture';

describe('a label', () => {
  it('is the nearest of 128, 512 and 896', () => {
    expect([0, 128, 320].map((code) => labelOf(0, code))).toEqual(Array(3).fill('background'));
    expect([321, 512, 704].map((code) => labelOf(0, code))).toEqual(Array(3).fill('shadow'));
    expect([705, 896, 1023].map((code) => labelOf(0, code))).toEqual(Array(3).fill('unknown'));
  });

  it('tells actor from background by coverage', () => {
    expect(labelOf(511, 128)).toBe('background');
    expect(labelOf(512, 128)).toBe('actor');
    expect(labelOf(1020, 896)).toBe('unknown');
  });
});
