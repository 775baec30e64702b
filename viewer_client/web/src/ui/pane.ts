// SPDX-License-Identifier: Apache-2.0
import type { ProbePoint } from '../view/depth_probe';
import type { PaneName } from '../view/messages';
import { el, setText } from './dom';
import { cross } from './icons';
import { fit, kHead_px, type Rect } from './layout';
import { span } from './numbers';

export interface PaneOptions {
  name: PaneName;
  title: string;
  /** What a screen reader calls the picture. */
  describes: string;
  /** What keys do in it. */
  keys: string;
  /** Width kept free at the picture's right. */
  side_px?: number;
}

/** One picture with its head: title, reading, controls; over it the probe's mark, its age, what is to be said. */
export class Pane {
  readonly name: PaneName;
  readonly root: HTMLElement;
  readonly frame: HTMLElement;
  readonly canvas: HTMLCanvasElement;
  readonly controls = el('div', { class: 'pane-controls' });
  readonly body = el('div', { class: 'pane-body' });
  readonly #title: HTMLElement;
  readonly #reading: HTMLElement;
  readonly #age: HTMLElement;
  readonly #note = el('p', { class: 'pane-note' });
  readonly #tag = el('span', { class: 'probe-tag' });
  readonly #mark = el('div', { class: 'probe' }, cross(), this.#tag);
  readonly #side_px: number;
  #picture_px = 0;

  constructor(options: PaneOptions) {
    const { name, title, describes, keys, side_px = 0 } = options;
    this.name = name;
    this.#side_px = side_px;
    this.#title = el('h2', { class: 'pane-title', text: title });
    this.#reading = el('span', { class: 'pane-reading', testid: `${name}-reading` });
    this.#age = el('div', { class: 'age', testid: `${name}-age` });
    this.#age.hidden = true;
    this.#note.hidden = true;
    this.#mark.hidden = true;
    this.canvas = el('canvas', {
      class: 'picture',
      testid: `${name}-canvas`,
      attributes: { role: 'img', 'aria-label': describes },
    });
    this.frame = el(
      'div',
      {
        class: 'frame',
        attributes: {
          tabindex: '0',
          'aria-label': `${describes}. ${keys}`,
          role: 'group',
        },
      },
      this.canvas,
      this.#mark,
      this.#age,
      this.#note,
    );
    this.body.append(this.frame);
    this.root = el(
      'section',
      { class: `pane pane-${name}`, testid: `pane-${name}`, attributes: { 'aria-label': title } },
      el('header', { class: 'pane-head' }, this.#title, this.#reading, this.controls),
      this.body,
    );
  }

  /** Puts the pane there, its picture as large as fits, or all of it (null). Returns the picture's height. */
  place(rect: Rect, picture_aspect: number | null): number {
    const aspect = picture_aspect ?? rect.width / Math.max(1, rect.height - kHead_px);
    const { style } = this.root;
    style.left = `${rect.x}px`;
    style.top = `${rect.y}px`;
    style.width = `${rect.width}px`;
    style.height = `${rect.height}px`;
    const picture = fit(Math.max(1, rect.width - this.#side_px), Math.max(1, rect.height - kHead_px), aspect);
    this.frame.style.width = `${picture.width}px`;
    this.frame.style.height = `${picture.height}px`;
    // In the middle where there is room; what stands at the right moves the picture only when it must.
    const free_px = rect.width - picture.width;
    this.frame.style.marginLeft = `${Math.floor(Math.min(free_px / 2, free_px - this.#side_px))}px`;
    this.#picture_px = picture.width;
    return picture.height;
  }

  set visible(visible: boolean) {
    this.root.hidden = !visible;
  }

  /** Device pixels across; 0 when hidden. */
  get pane_px(): number {
    return this.root.hidden ? 0 : Math.max(1, Math.round(this.#picture_px * devicePixelRatio));
  }

  set title(title: string) {
    setText(this.#title, title);
    this.root.setAttribute('aria-label', title);
  }

  setReading(text: string, detail = ''): void {
    setText(this.#reading, text);
    setText(this.#tag, text);
    if (this.#reading.title !== detail) this.#reading.title = detail;
  }

  /** The same place is marked in every pane; the one that was pointed into writes the reading beside it. */
  setProbe(point: ProbePoint | null, pointed: boolean): void {
    this.#mark.hidden = point === null;
    this.#tag.hidden = !pointed;
    if (point === null) return;
    this.#mark.classList.toggle('at-right', point.u > 0.75);
    this.#mark.classList.toggle('at-foot', point.v > 0.85);
    this.#mark.style.left = `${100 * point.u}%`;
    this.#mark.style.top = `${100 * point.v}%`;
  }

  /** Why this pane alone has no picture; empty when it has. */
  setNote(text: string): void {
    this.#note.hidden = text === '';
    setText(this.#note, text);
  }

  /** Null: the picture is fresh. */
  setStale(age_s: number | null): void {
    this.root.classList.toggle('stale', age_s !== null);
    this.#age.hidden = age_s === null;
    if (age_s !== null) setText(this.#age, `${span(age_s)} old`);
  }
}
