// SPDX-License-Identifier: Apache-2.0

/** Pixels of our own making on their way into a canvas; the memory is kept from picture to picture. */
export class Raster {
  #image: ImageData | null = null;
  #words = new Uint32Array(0);

  /** Memory for width x height pixel words, in whatever state the last picture left it. */
  words(width: number, height: number): Uint32Array {
    if (this.#image === null || this.#image.width !== width || this.#image.height !== height) {
      this.#image = new ImageData(width, height);
      this.#words = new Uint32Array(this.#image.data.buffer);
    }
    return this.#words;
  }

  put(context: OffscreenCanvasRenderingContext2D): void {
    if (this.#image !== null) context.putImageData(this.#image, 0, 0);
  }
}
