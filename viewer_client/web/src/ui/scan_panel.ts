// SPDX-License-Identifier: Apache-2.0
import type { ScanCell, ScanProgress } from '../transport/scan_progress';
import { el, setData, setText } from './dom';
import { count, fixed } from './numbers';
import { kSilentAfter_s, scanSentence } from './scan_sentence';

const kCellNames: Readonly<Record<ScanCell, string>> = {
  to_come: 'to come',
  recorded: 'recorded',
  left_out: 'left out',
  head: 'the head',
};
const kMostNotes = 4;

/** A live scan, on the main picture: where the head has been, what is at work, what came of it. */
export class ScanPanel {
  readonly root: HTMLElement;
  readonly #sentence = el('p', { class: 'scan-sentence', testid: 'scan-sentence' });
  readonly #map = el('div', { class: 'scan-map', testid: 'scan-map', attributes: { role: 'img' } });
  readonly #pan = [el('span'), el('span', { text: 'pan' }), el('span')] as const;
  readonly #tilt = [el('span'), el('span', { text: 'tilt' }), el('span')] as const;
  readonly #view: HTMLElement;
  readonly #notes = el('ul', { class: 'scan-notes', testid: 'scan-notes' });

  constructor() {
    this.#view = el(
      'div',
      { class: 'scan-view' },
      el('div', { class: 'scan-tilt' }, ...this.#tilt),
      this.#map,
      el('div', { class: 'scan-pan' }, ...this.#pan),
    );
    const words = el(
      'div',
      { attributes: { role: 'status', 'aria-live': 'polite' } },
      this.#sentence,
      this.#notes,
    );
    this.root = el('section', { class: 'scan', testid: 'scan', attributes: { 'aria-label': 'Scan' } });
    this.root.append(this.#view, words);
    this.root.hidden = true;
  }

  /** Null: no scan has been heard of for a while. */
  show(scan: ScanProgress | null): void {
    this.root.hidden = scan === null;
    if (scan === null) return;
    const { sentence, tone } = scanSentence(scan);
    setText(this.#sentence, sentence);
    setData(this.root, 'tone', tone);
    setData(this.root, 'state', scan.state);
    const at_work = scan.state === 'sweep' || scan.state === 'compute';
    this.root.classList.toggle('silent', at_work && scan.age_s > kSilentAfter_s);
    this.#showMap(scan);
    this.#showNotes(scan);
  }

  #showMap({ columns, rows, cells, pan_deg, tilt_deg, positions, recorded, left_out }: ScanProgress): void {
    this.#view.hidden = cells.length === 0;
    if (cells.length === 0) return;
    const { style, children } = this.#map;
    style.gridTemplateColumns = `repeat(${columns}, 1fr)`;
    style.gridTemplateRows = `repeat(${rows}, 1fr)`;
    while (children.length > cells.length) this.#map.lastElementChild?.remove();
    while (children.length < cells.length) this.#map.append(el('i'));
    cells.forEach((cell, index) => setData(children[index] as HTMLElement, 'cell', kCellNames[cell]));
    const said = `Swept: ${count(recorded)} of ${count(positions)} positions, ${count(left_out)} left out`;
    if (this.#map.getAttribute('aria-label') !== said) this.#map.setAttribute('aria-label', said);
    const degrees = (deg: number | undefined): string => `${fixed(deg ?? null, 0)}°`;
    setText(this.#pan[0], degrees(pan_deg[0]));
    setText(this.#pan[2], degrees(pan_deg[1]));
    setText(this.#tilt[0], degrees(tilt_deg[0]));
    setText(this.#tilt[2], degrees(tilt_deg[1]));
  }

  #showNotes({ notes }: ScanProgress): void {
    const shown = notes.slice(-kMostNotes);
    const { children } = this.#notes;
    while (children.length > shown.length) this.#notes.lastElementChild?.remove();
    while (children.length < shown.length) this.#notes.append(el('li'));
    shown.forEach((note, index) => setText(children[index] as HTMLElement, note));
    this.#notes.hidden = shown.length === 0;
  }
}
