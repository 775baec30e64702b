// SPDX-License-Identifier: Apache-2.0
import { kLabelColors } from '../view/label_view';
import type { MatteMode } from '../view/messages';
import type { Label } from '../decode/depth_picture';
import { el } from './dom';

const kModes: readonly { mode: MatteMode; title: string; key: string }[] = [
  { mode: 'matte', title: 'Matte', key: 'M' },
  { mode: 'label', title: 'Label', key: 'L' },
  { mode: 'light', title: 'Light', key: 'K' },
];
const kLegend: readonly Label[] = ['actor', 'shadow', 'unknown'];

/** Which of its pictures the matte pane shows, and what the label colours mean. */
export class MatteControls {
  readonly root: HTMLElement;
  readonly legend: HTMLElement;
  readonly #buttons = new Map<MatteMode, HTMLButtonElement>();

  constructor(onMode: (mode: MatteMode) => void) {
    const buttons = kModes.map(({ mode, title, key }) => {
      const button = el('button', {
        class: 'segment-button',
        text: title,
        testid: `mode-${mode}`,
        attributes: { type: 'button', title: `${title} (${key})` },
      });
      button.addEventListener('click', () => onMode(mode));
      this.#buttons.set(mode, button);
      return button;
    });
    this.root = el(
      'div',
      { class: 'segmented', attributes: { role: 'group', 'aria-label': 'Matte, label or light map' } },
      ...buttons,
    );
    const entries = kLegend.map((label) => {
      const swatch = el('span', { class: 'swatch' });
      swatch.style.backgroundColor = `rgb(${kLabelColors[label].join(' ')})`;
      return el('li', {}, swatch, el('span', { text: label }));
    });
    this.legend = el(
      'ul',
      { class: 'legend', testid: 'legend', attributes: { 'aria-label': 'Label colours' } },
      ...entries,
    );
  }

  setMode(mode: MatteMode): void {
    for (const [name, button] of this.#buttons) button.setAttribute('aria-pressed', String(name === mode));
    this.legend.hidden = mode !== 'label';
  }
}
