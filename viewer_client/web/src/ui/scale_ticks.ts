// SPDX-License-Identifier: Apache-2.0
import type { DepthRange } from '../decode/depth_code';

const kSteps_m = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 25, 50, 100];

/** Where a depth stands on the scale: 0 at far (top), 1 at near (bottom). */
export function scalePosition(z_m: number, range: DepthRange): number {
  return Math.min(1, Math.max(0, (range.far_m - z_m) / (range.far_m - range.near_m)));
}

export interface Tick {
  z_m: number;
  /** With as many digits as the step needs, the same for all. */
  text: string;
}

/** Round depths inside the range, at most `most`, clear of both ends, which have labels of their own. */
export function scaleTicks(range: DepthRange, most: number): Tick[] {
  const length_m = range.far_m - range.near_m;
  const step_m = kSteps_m.find((step) => length_m / step <= most) ?? length_m / Math.max(1, most);
  const clear_m = length_m / (2 * Math.max(1, most));
  const digits = (`${Number(step_m.toFixed(2))}`.split('.')[1] ?? '').length;
  const ticks: Tick[] = [];
  for (let index = Math.ceil(range.near_m / step_m); index * step_m < range.far_m; ++index) {
    const z_m = index * step_m;
    if (z_m - range.near_m >= clear_m && range.far_m - z_m >= clear_m)
      ticks.push({ z_m, text: z_m.toFixed(digits) });
  }
  return ticks;
}
