// SPDX-License-Identifier: Apache-2.0
import { el } from './dom';
import { icon } from './icons';
import type { Shortcut } from './shortcuts';

/** The list of keys. */
export class HelpDialog {
  readonly root: HTMLDialogElement;

  constructor(entries: readonly Pick<Shortcut, 'label' | 'does'>[]) {
    const close = el(
      'button',
      { class: 'bar-button', attributes: { type: 'button', 'aria-label': 'Close the list of keys' } },
      icon('close'),
    );
    const rows = entries.flatMap(({ label, does }) => [
      el('dt', {}, el('kbd', { text: label })),
      el('dd', { text: does }),
    ]);
    this.root = el(
      'dialog',
      { class: 'help', testid: 'help', attributes: { 'aria-label': 'Keys' } },
      el('header', { class: 'details-head' }, el('h2', { text: 'Keys' }), close),
      el('dl', { class: 'keys' }, ...rows),
    );
    close.addEventListener('click', () => this.root.close());
    this.root.addEventListener('click', (event) => {
      if (event.target === this.root) this.root.close();
    });
  }

  toggle(): void {
    if (this.root.open) this.root.close();
    else this.root.showModal();
  }
}
