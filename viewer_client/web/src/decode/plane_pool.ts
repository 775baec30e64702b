// SPDX-License-Identifier: Apache-2.0

/**
 * Reused memory for planes: a picture is 2.4 MB thirty times a second. Holds at most `capacity` free buffers;
 * the number in use is bounded by who holds pictures (latest, frozen, one in flight).
 */
export class PlanePool {
  readonly #capacity: number;
  #free: ArrayBuffer[] = [];

  constructor(capacity = 4) {
    this.#capacity = capacity;
  }

  take(bytes: number): ArrayBuffer {
    const index = this.#free.findIndex((buffer) => buffer.byteLength === bytes);
    if (index < 0) return new ArrayBuffer(bytes);
    return this.#free.splice(index, 1)[0] ?? new ArrayBuffer(bytes);
  }

  give(buffer: ArrayBuffer): void {
    this.#free.push(buffer);
    if (this.#free.length > this.#capacity) this.#free.shift();
  }
}
