// SPDX-License-Identifier: Apache-2.0
import type { ProbePoint } from '../view/depth_probe';
import type { PictureSize } from '../view/messages';
import type { Pane } from './pane';

const kArrows: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};
const kFastStep_px = 16;

/** Moves a point by whole pixels of the picture, onto a pixel's middle, and keeps it inside. */
export function movePoint(from: ProbePoint, dx: number, dy: number, size: PictureSize): ProbePoint {
  const along = (position: number, step: number, length: number): number => {
    const pixel = Math.floor(position * length) + step;
    return (Math.min(length - 1, Math.max(0, pixel)) + 0.5) / length;
  };
  return { u: along(from.u, dx, size.width), v: along(from.v, dy, size.height) };
}

/** Lets mouse, touch and arrow keys point at a place in a pane's picture. */
export class ProbeInput {
  readonly #frame: HTMLElement;
  readonly #size: () => PictureSize;
  readonly #onPoint: (point: ProbePoint | null) => void;
  #point: ProbePoint | null = null;

  constructor(pane: Pane, size: () => PictureSize, onPoint: (point: ProbePoint | null) => void) {
    this.#frame = pane.frame;
    this.#size = size;
    this.#onPoint = onPoint;
    const frame = pane.frame;
    frame.addEventListener('pointermove', (event) => this.#pointAt(event));
    frame.addEventListener('pointerdown', (event) => this.#pointAt(event));
    // A finger that was lifted leaves its reading; a mouse that went away takes it along.
    frame.addEventListener('pointerleave', (event) => {
      if (event.pointerType === 'mouse') this.#set(null);
    });
    frame.addEventListener('keydown', (event) => this.#key(event));
    frame.addEventListener('blur', () => this.#set(null));
  }

  #pointAt(event: PointerEvent): void {
    const box = this.#frame.getBoundingClientRect();
    const u = (event.clientX - box.left) / box.width;
    const v = (event.clientY - box.top) / box.height;
    this.#set(u >= 0 && u < 1 && v >= 0 && v < 1 ? { u, v } : null);
  }

  #key(event: KeyboardEvent): void {
    const arrow = kArrows[event.key];
    if (arrow === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    const step = event.shiftKey ? kFastStep_px : 1;
    const from = this.#point;
    this.#set(
      from === null ? { u: 0.5, v: 0.5 } : movePoint(from, step * arrow[0], step * arrow[1], this.#size()),
    );
  }

  #set(point: ProbePoint | null): void {
    if (point === null && this.#point === null) return;
    this.#point = point;
    this.#onPoint(point);
  }
}
