// SPDX-License-Identifier: Apache-2.0
import type { DepthPicture } from '../decode/depth_picture';
import { AlphaRing, type Alpha } from './alpha_ring';
import { Raster } from './raster';
import { Surface } from './surface';

const kSquare_px = 16;
const kDark = '#3b4047';
const kLight = '#565c65';

function checkerboard(context: OffscreenCanvasRenderingContext2D): CanvasPattern | null {
  const tile = Surface.create();
  tile.resize(2 * kSquare_px, 2 * kSquare_px);
  tile.context.fillStyle = kDark;
  tile.context.fillRect(0, 0, 2 * kSquare_px, 2 * kSquare_px);
  tile.context.fillStyle = kLight;
  tile.context.fillRect(0, 0, kSquare_px, kSquare_px);
  tile.context.fillRect(kSquare_px, kSquare_px, kSquare_px, kSquare_px);
  return context.createPattern(tile.canvas, 'repeat');
}

/** The program's picture through the actor's alpha, over a checkerboard. */
export class MatteView {
  readonly #mattes = new AlphaRing();
  readonly #color = Surface.create();
  readonly #mask = Surface.create();
  readonly #cut = Surface.create();
  readonly #raster = new Raster();
  #checkerboard: CanvasPattern | null = null;
  /** The colour picture that waits for its matte; null once it was drawn. */
  #waiting: bigint | null = null;

  /** Keeps a copy of a width x height picture. `pane_px` at most half its width halves the work. */
  takeColor(picture: CanvasImageSource, width: number, height: number, frame: bigint, pane_px: number): void {
    const scale = pane_px <= width / 2 ? 0.5 : 1;
    this.#color.resize(Math.ceil(width * scale), Math.ceil(height * scale));
    this.#color.context.drawImage(picture, 0, 0, this.#color.canvas.width, this.#color.canvas.height);
    this.#waiting = frame;
  }

  /** Keeps a copy of the picture's coverage. */
  takeCoverage(picture: DepthPicture): void {
    this.#mattes.add(picture.frame, picture.coverage);
  }

  /** Draws when both halves of the newest colour frame are there; says whether it did. */
  draw(surface: Surface): boolean {
    const matte = this.#waiting === null ? null : this.#mattes.find(this.#waiting);
    if (matte === null) return false;
    this.#waiting = null;
    this.#fillMask(matte);
    const { width, height } = this.#color.canvas;
    this.#cut.resize(width, height);
    this.#cut.context.globalCompositeOperation = 'copy';
    this.#cut.context.drawImage(this.#color.canvas, 0, 0);
    this.#cut.context.globalCompositeOperation = 'destination-in';
    this.#cut.context.drawImage(this.#mask.canvas, 0, 0, width, height);
    surface.resize(width, height);
    this.#checkerboard ??= checkerboard(surface.context);
    surface.context.fillStyle = this.#checkerboard ?? kDark;
    surface.context.fillRect(0, 0, width, height);
    surface.context.drawImage(this.#cut.canvas, 0, 0);
    return true;
  }

  /** Pictures of an earlier connection must not meet those of the next. */
  reset(): void {
    this.#mattes.clear();
    this.#waiting = null;
  }

  #fillMask({ width, height, samples }: Alpha): void {
    const bytes = new Uint8Array(this.#raster.words(width, height).buffer);
    for (let from = 0, to = 3; from < samples.length; ++from, to += 4) bytes[to] = samples[from] ?? 0;
    this.#mask.resize(width, height);
    this.#raster.put(this.#mask.context);
  }
}
