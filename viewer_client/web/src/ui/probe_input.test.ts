// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { movePoint } from './probe_input';

const kSize = { width: 1024, height: 768 };

describe('the probe under arrow keys', () => {
  it('moves by whole pixels onto their middle', () => {
    const moved = movePoint({ u: 100.9 / 1024, v: 50.1 / 768 }, 1, -1, kSize);
    expect([moved.u * 1024, moved.v * 768]).toEqual([101.5, 49.5]);
  });

  it('stays inside the picture', () => {
    const corner = movePoint({ u: 0.001, v: 0.999 }, -16, 16, kSize);
    expect([corner.u * 1024, corner.v * 768]).toEqual([0.5, 767.5]);
  });
});
