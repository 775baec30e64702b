// SPDX-License-Identifier: Apache-2.0

/** Depths of code 1023 and of code 1, in force for one picture (SPEC 4.1). */
export interface DepthRange {
  near_m: number;
  far_m: number;
}

export const kDepthCodes = 1024;

/** z of a code in metres: 1/z = 1/far + (code - 1)/1022 (1/near - 1/far); 0 = nothing known. */
export function metresOfCode(code: number, range: DepthRange): number {
  if (code <= 0) return 0;
  const inverse_far = 1 / range.far_m;
  return 1 / (inverse_far + ((code - 1) / 1022) * (1 / range.near_m - inverse_far));
}

export function sameRange(a: DepthRange, b: DepthRange): boolean {
  return a.near_m === b.near_m && a.far_m === b.far_m;
}
