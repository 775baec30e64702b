// SPDX-License-Identifier: Apache-2.0

// Turbo, the perceptually ordered rainbow of A. Mikhailov (2019), as one polynomial of degree five a channel in
// t in [0, 1], constant term first. 0 is deep blue, 1 is deep red.
const kRed = [0.136, 4.615, -42.66, 132.131, -152.942, 59.286] as const;
const kGreen = [0.091, 2.194, 4.843, -14.185, 4.277, 2.83] as const;
const kBlue = [0.107, 12.642, -60.582, 110.363, -89.903, 27.348] as const;

export interface Rgb {
  red: number;
  green: number;
  blue: number;
}

function channel(coefficients: readonly number[], t: number): number {
  const value = coefficients.reduceRight((sum, coefficient) => sum * t + coefficient, 0);
  return Math.round(255 * Math.min(1, Math.max(0, value)));
}

/** sRGB, 0..255 each. t outside [0, 1] takes the end's colour. */
export function turbo(t: number): Rgb {
  const at = Math.min(1, Math.max(0, t));
  return { red: channel(kRed, at), green: channel(kGreen, at), blue: channel(kBlue, at) };
}

/** A pixel of ImageData as the word to write through a Uint32Array, in this machine's byte order. */
export function pixelWord(red: number, green: number, blue: number, alpha = 255): number {
  const bytes = new Uint8Array([red, green, blue, alpha]);
  return new Uint32Array(bytes.buffer)[0] ?? 0;
}
