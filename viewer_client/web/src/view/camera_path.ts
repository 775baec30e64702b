// SPDX-License-Identifier: Apache-2.0
import { BufferAttribute, BufferGeometry, Line, LineBasicMaterial } from 'three';
import type { Vector3 } from '../transport/scene';

const kMostPoints = 600;
const kStep_m = 0.01;
const kColor = 0x7c8792;

/** Where the rig's camera has been lately; a point each centimetre. */
export class CameraPath {
  readonly line: Line;
  readonly #positions = new BufferAttribute(new Float32Array(3 * kMostPoints), 3);
  #count = 0;

  constructor() {
    const geometry = new BufferGeometry().setAttribute('position', this.#positions);
    geometry.setDrawRange(0, 0);
    this.line = new Line(geometry, new LineBasicMaterial({ color: kColor }));
    // Its extent changes all the time: cheaper to draw than to bound.
    this.line.frustumCulled = false;
  }

  add(point: Vector3): void {
    const array = this.#positions.array as Float32Array;
    const last = 3 * (this.#count - 1);
    const step_m = Math.hypot(...point.map((value, axis) => value - (array[last + axis] ?? Infinity)));
    if (this.#count > 0 && step_m < kStep_m) return;
    if (this.#count === kMostPoints) {
      array.copyWithin(0, 3);
      this.#count -= 1;
    }
    array.set(point, 3 * this.#count);
    this.#count += 1;
    this.#positions.needsUpdate = true;
    this.line.geometry.setDrawRange(0, this.#count);
  }

  clear(): void {
    this.#count = 0;
    this.line.geometry.setDrawRange(0, 0);
  }
}
