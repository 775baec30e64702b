// SPDX-License-Identifier: Apache-2.0
import type { DepthRange } from '../decode/depth_code';
import { sameRange } from '../decode/depth_code';
import { depthColor } from '../view/depth_palette';
import { el } from './dom';
import { scalePosition, scaleTicks } from './scale_ticks';

const kBarRows = 256;
const kTickEvery_px = 36;

/** The depth map's ruler: far at the top, near at the bottom, a mark at the depth under the cursor. */
export class DepthScale {
  readonly root: HTMLElement;
  readonly #bar = el('canvas', { class: 'scale-bar', attributes: { width: '1', height: `${kBarRows}` } });
  readonly #ticks = el('div', { class: 'scale-ticks' });
  readonly #mark = el('div', { class: 'scale-mark' });
  #range: DepthRange | null = null;
  #height_px = 0;

  constructor() {
    this.#mark.hidden = true;
    this.root = el(
      'div',
      { class: 'scale', testid: 'depth-scale', attributes: { role: 'img' } },
      el('div', { class: 'scale-body' }, this.#bar, this.#ticks, this.#mark),
    );
    this.root.hidden = true;
  }

  resize(height_px: number): void {
    if (height_px === this.#height_px) return;
    this.#height_px = height_px;
    this.root.style.height = `${height_px}px`;
    this.#draw();
  }

  setRange(range: DepthRange | null): void {
    if (range === null || (this.#range !== null && sameRange(range, this.#range))) return;
    this.#range = range;
    this.root.hidden = false;
    this.root.setAttribute(
      'aria-label',
      `Depth scale from ${range.near_m.toFixed(2)} to ${range.far_m.toFixed(2)} metres`,
    );
    this.root.dataset['nearM'] = `${range.near_m}`;
    this.root.dataset['farM'] = `${range.far_m}`;
    this.#draw();
  }

  setMark(z_m: number | null): void {
    this.#mark.hidden = z_m === null || this.#range === null;
    if (z_m !== null && this.#range !== null)
      this.#mark.style.top = `${100 * scalePosition(z_m, this.#range)}%`;
  }

  #draw(): void {
    const range = this.#range;
    const context = this.#bar.getContext('2d');
    if (range === null || context === null) return;
    for (let row = 0; row < kBarRows; ++row) {
      const z_m = range.far_m - (row / (kBarRows - 1)) * (range.far_m - range.near_m);
      const { red, green, blue } = depthColor(z_m, range);
      context.fillStyle = `rgb(${red} ${green} ${blue})`;
      context.fillRect(0, row, 1, 1);
    }
    const most = Math.max(1, Math.floor(this.#height_px / kTickEvery_px));
    const round = scaleTicks(range, most).map(({ z_m, text }) => this.#tick(z_m, text, range));
    this.#ticks.replaceChildren(
      this.#tick(range.far_m, `${range.far_m.toFixed(2)} m`, range, 'scale-end'),
      ...round,
      this.#tick(range.near_m, `${range.near_m.toFixed(2)} m`, range, 'scale-end'),
    );
  }

  #tick(z_m: number, text: string, range: DepthRange, extra = ''): HTMLElement {
    const tick = el('span', { class: `scale-tick ${extra}`, text });
    tick.style.top = `${100 * scalePosition(z_m, range)}%`;
    return tick;
  }
}
