// SPDX-License-Identifier: Apache-2.0
import { sameRange, type DepthRange } from '../decode/depth_code';
import type { DepthPicture, Plane } from '../decode/depth_picture';
import { depthPalette } from './depth_palette';
import { Raster } from './raster';
import { Surface } from './surface';

/** Writes the colours of every `step`-th code; `out` is ceil(width/step) x ceil(height/step). */
export function paintDepth(depth: Plane, palette: Uint32Array, step: number, out: Uint32Array): void {
  const { samples, stride, width, height } = depth;
  let to = 0;
  for (let y = 0; y < height; y += step) {
    const row = y * stride;
    for (let x = 0; x < width; x += step) out[to++] = palette[(samples[row + x] ?? 0) & 1023] ?? 0;
  }
}

/** False colour of the composite's depth. */
export class DepthView {
  readonly #surface: Surface;
  readonly #raster = new Raster();
  #palette: Uint32Array = new Uint32Array(0);
  #range: DepthRange = { near_m: 0, far_m: 0 };

  constructor(canvas: OffscreenCanvas) {
    this.#surface = new Surface(canvas, { alpha: false });
  }

  /** Borrows the picture. A pane of at most half its width is drawn from every second sample. */
  draw(picture: DepthPicture, pane_px: number): void {
    if (!sameRange(picture.range, this.#range)) {
      this.#range = picture.range;
      this.#palette = depthPalette(picture.range);
    }
    const { width, height } = picture.depth;
    const step = pane_px <= width / 2 ? 2 : 1;
    const out_width = Math.ceil(width / step);
    const out_height = Math.ceil(height / step);
    paintDepth(picture.depth, this.#palette, step, this.#raster.words(out_width, out_height));
    this.#surface.resize(out_width, out_height);
    this.#raster.put(this.#surface.context);
  }
}
