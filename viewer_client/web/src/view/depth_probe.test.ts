// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { metresOfCode } from '../decode/depth_code';
import type { DepthPicture } from '../decode/depth_picture';
import { readDepth } from './depth_probe';

const kRange = { near_m: 1, far_m: 5 };

/** 4 x 4, rows padded to 6. */
function picture(codes: number[][]): DepthPicture {
  const samples = Uint16Array.from(codes.flatMap((row) => [...row, 1023, 1023]));
  const half = { samples: Uint16Array.from([0, 1020, 0, 0]), stride: 2, width: 2, height: 2 };
  const label = { samples: Uint16Array.from([128, 128, 512, 896]), stride: 2, width: 2, height: 2 };
  return {
    frame: 9n,
    capture_us: 0n,
    range: kRange,
    depth: { samples, stride: 6, width: 4, height: 4 },
    coverage: half,
    label,
    release: () => undefined,
  };
}

const kPicture = picture([
  [0, 0, 100, 200],
  [0, 0, 300, 400],
  [500, 600, 700, 800],
  [900, 910, 920, 0],
]);
const at = (x: number, y: number): { u: number; v: number } => ({ u: (x + 0.5) / 4, v: (y + 0.5) / 4 });

describe('the depth probe', () => {
  it('reads exactly the pixel that is pointed at', () => {
    const reading = readDepth(kPicture, at(2, 1));
    expect([reading.x, reading.y, reading.frame]).toEqual([2, 1, '9']);
    expect(reading.z_m).toBe(metresOfCode(300, kRange));
  });

  it('has no metres where nothing is known', () => {
    expect(readDepth(kPicture, at(0, 0))).toMatchObject({ z_m: null, median_m: null });
    expect(readDepth(kPicture, at(3, 3)).z_m).toBeNull();
  });

  it('takes the median of the known ones of 3x3, also at a border', () => {
    expect(readDepth(kPicture, at(2, 2)).median_m).toBe(metresOfCode(700, kRange));
    expect(readDepth(kPicture, at(3, 3)).median_m).toBe(metresOfCode(800, kRange));
    expect(readDepth(kPicture, at(0, 1)).median_m).toBe(metresOfCode(600, kRange));
  });

  it('reads coverage and label of the half-size sample below it', () => {
    expect(readDepth(kPicture, at(3, 0))).toMatchObject({ coverage: 1, label: 'actor' });
    expect(readDepth(kPicture, at(1, 3))).toMatchObject({ coverage: 0, label: 'shadow' });
    expect(readDepth(kPicture, at(2, 2)).label).toBe('unknown');
  });

  it('stays inside the picture', () => {
    expect(readDepth(kPicture, { u: 7, v: -3 })).toMatchObject({ x: 3, y: 0 });
  });
});
