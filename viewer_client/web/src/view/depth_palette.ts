// SPDX-License-Identifier: Apache-2.0
import { kDepthCodes, metresOfCode, type DepthRange } from '../decode/depth_code';
import { pixelWord, turbo, type Rgb } from './turbo';

export const kUnknownGrey = 0x20;

/** Linear in metres, so that the scale reads like a ruler; near is warm. */
export function depthColor(z_m: number, range: DepthRange): Rgb {
  return turbo((range.far_m - z_m) / (range.far_m - range.near_m));
}

/** Pixel word of every depth code. */
export function depthPalette(range: DepthRange): Uint32Array {
  const palette = new Uint32Array(kDepthCodes);
  palette[0] = pixelWord(kUnknownGrey, kUnknownGrey, kUnknownGrey);
  for (let code = 1; code < kDepthCodes; ++code) {
    const { red, green, blue } = depthColor(metresOfCode(code, range), range);
    palette[code] = pixelWord(red, green, blue);
  }
  return palette;
}
