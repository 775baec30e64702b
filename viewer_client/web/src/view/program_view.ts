// SPDX-License-Identifier: Apache-2.0
import { Surface } from './surface';

/** The colour composite as it came. The page scales the canvas, not the worker. */
export class ProgramView {
  readonly #surface: Surface;

  constructor(canvas: OffscreenCanvas) {
    this.#surface = new Surface(canvas, { alpha: false });
  }

  /** What was drawn last, already as RGB. */
  get canvas(): OffscreenCanvas {
    return this.#surface.canvas;
  }

  /** Borrows the frame. */
  draw(frame: VideoFrame): void {
    this.#surface.resize(frame.displayWidth, frame.displayHeight);
    this.#surface.context.drawImage(frame, 0, 0);
  }
}
