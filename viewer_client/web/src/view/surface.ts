// SPDX-License-Identifier: Apache-2.0

/** Any canvas of a worker with its context. */
export class Surface {
  readonly canvas: OffscreenCanvas;
  readonly context: OffscreenCanvasRenderingContext2D;

  constructor(canvas: OffscreenCanvas, settings: CanvasRenderingContext2DSettings = {}) {
    const context = canvas.getContext('2d', settings);
    if (context === null) throw new Error('this browser gives no 2d context to a worker');
    this.canvas = canvas;
    this.context = context;
  }

  static create(): Surface {
    return new Surface(new OffscreenCanvas(1, 1));
  }

  /** Setting a canvas' size clears it: only when it changes. */
  resize(width: number, height: number): void {
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
  }
}
