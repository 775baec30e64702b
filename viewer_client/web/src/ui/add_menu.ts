// SPDX-License-Identifier: Apache-2.0
import { el, setText } from './dom';
import { icon } from './icons';

/** "+ Add": the models that may be added; the chosen one is placed by a click into the program. */
export class AddMenu {
  readonly root: HTMLElement;
  readonly #button: HTMLButtonElement;
  readonly #label = el('span', { text: 'Add' });
  readonly #menu = el('ul', { class: 'menu', testid: 'add-menu', attributes: { 'aria-label': 'Models' } });
  readonly #onChoose: (file: string) => void;
  #models = '';

  constructor(onChoose: (file: string) => void) {
    this.#onChoose = onChoose;
    this.#button = el(
      'button',
      {
        class: 'segment-button',
        testid: 'add',
        attributes: { type: 'button', title: 'Add an object (A)', 'aria-expanded': 'false' },
      },
      icon('add'),
      this.#label,
    );
    this.root = el('div', { class: 'add' }, this.#button, this.#menu);
    this.#menu.hidden = true;
    this.#button.addEventListener('click', () => this.toggle());
    this.root.addEventListener('keydown', (event) => this.#key(event));
    document.addEventListener('pointerdown', (event) => {
      if (event.target instanceof Node && !this.root.contains(event.target)) this.#open(false);
    });
  }

  toggle(): void {
    this.#open(this.#menu.hidden);
    if (!this.#menu.hidden) this.#menu.querySelector('button')?.focus();
  }

  setModels(models: readonly string[]): void {
    const all = models.join('\n');
    if (all === this.#models && this.#menu.hasChildNodes()) return;
    this.#models = all;
    const items = models.map((file) => {
      const button = el('button', { class: 'menu-item', text: file, attributes: { type: 'button' } });
      button.addEventListener('click', () => {
        this.#open(false);
        this.#onChoose(file);
      });
      return el('li', {}, button);
    });
    const none = el('li', { class: 'quiet menu-item', text: 'No models lie beside scene.yaml.' });
    this.#menu.replaceChildren(...(items.length > 0 ? items : [none]));
  }

  /** While a click is waited for the button says so. */
  setPlacing(placing: boolean): void {
    this.#button.setAttribute('aria-pressed', String(placing));
    setText(this.#label, placing ? 'Placing...' : 'Add');
  }

  #open(open: boolean): void {
    this.#menu.hidden = !open;
    this.#button.setAttribute('aria-expanded', String(open));
  }

  #key(event: KeyboardEvent): void {
    if (this.#menu.hidden) return;
    const items = [...this.#menu.querySelectorAll('button')];
    const at = items.findIndex((item) => item === document.activeElement);
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step !== undefined) items[(at + step + items.length) % items.length]?.focus();
    else if (event.key === 'Escape') {
      this.#open(false);
      this.#button.focus();
    } else return;
    event.preventDefault();
  }
}
