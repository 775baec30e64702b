// SPDX-License-Identifier: Apache-2.0
import { el, setData, setText } from './dom';
import type { State } from './state_sentence';

/**
 * The state's sentence on the main picture: in its middle when there is nothing fresh to see, else at its
 * upper edge: the lower one is where feet touch the floor.
 */
export class Notice {
  readonly root: HTMLElement;
  readonly #sentence = el('p', { class: 'notice-sentence', testid: 'sentence' });
  readonly #advice = el('p', { class: 'notice-advice', testid: 'advice' });

  constructor() {
    this.root = el(
      'div',
      { class: 'notice', testid: 'notice', attributes: { role: 'status', 'aria-live': 'polite' } },
      this.#sentence,
      this.#advice,
    );
  }

  show(state: State, picture_is_fresh: boolean): void {
    setText(this.#sentence, state.sentence);
    setText(this.#advice, state.advice);
    this.#advice.hidden = state.advice === '';
    this.root.hidden = state.sentence === '';
    setData(this.root, 'place', picture_is_fresh ? 'head' : 'middle');
    setData(this.root, 'tone', state.tone);
  }
}
