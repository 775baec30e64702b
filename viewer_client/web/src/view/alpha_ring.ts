// SPDX-License-Identifier: Apache-2.0
import type { Plane } from '../decode/depth_picture';

/** Coverage of one frame, 0..255 each, without stride. */
export interface Alpha {
  frame: bigint;
  width: number;
  height: number;
  samples: Uint8Array;
}

/** Writes coverage (4 x alpha) as the nearest alpha. `out` holds width x height of the plane. */
export function alphaOf(coverage: Plane, out: Uint8Array): void {
  const { samples, stride, width, height } = coverage;
  let to = 0;
  for (let y = 0; y < height; ++y) {
    const row = y * stride;
    for (let x = 0; x < width; ++x) out[to++] = Math.min(255, ((samples[row + x] ?? 0) + 2) >> 2);
  }
}

/**
 * The mattes of the last pictures. Colour and depth of one frame are decoded apart, on a busy machine up to half
 * a second apart; a matte is only ever laid on its own frame.
 */
export class AlphaRing {
  readonly #capacity: number;
  #mattes: Alpha[] = [];

  constructor(capacity = 16) {
    this.#capacity = capacity;
  }

  add(frame: bigint, coverage: Plane): void {
    const { width, height } = coverage;
    const oldest = this.#mattes.length >= this.#capacity ? this.#mattes.shift() : undefined;
    const fits = oldest !== undefined && oldest.samples.length === width * height;
    const samples = fits ? oldest.samples : new Uint8Array(width * height);
    alphaOf(coverage, samples);
    this.#mattes.push({ frame, width, height, samples });
  }

  find(frame: bigint): Alpha | null {
    return this.#mattes.find((matte) => matte.frame === frame) ?? null;
  }

  clear(): void {
    this.#mattes = [];
  }
}
