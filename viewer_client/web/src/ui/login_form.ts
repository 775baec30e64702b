// SPDX-License-Identifier: Apache-2.0
import { el, setText } from './dom';

/** Asks for a token, over the main picture. */
export class LoginForm {
  readonly root: HTMLFormElement;
  readonly #field = el('input', {
    class: 'field',
    testid: 'token',
    attributes: { type: 'password', id: 'token', autocomplete: 'off', spellcheck: 'false', required: '' },
  });
  readonly #button = el('button', {
    class: 'primary',
    testid: 'login-button',
    text: 'Log in',
    attributes: { type: 'submit' },
  });
  readonly #wrong = el('p', { class: 'login-wrong', testid: 'login-wrong', attributes: { role: 'alert' } });

  constructor(onToken: (token: string) => void) {
    this.root = el(
      'form',
      { class: 'login', testid: 'login', attributes: { 'aria-label': 'Log in' } },
      el('h2', { text: 'This studio asks who you are' }),
      el('label', {
        class: 'quiet',
        text: 'Paste the token that its operator gave you.',
        attributes: { for: 'token' },
      }),
      el('div', { class: 'login-line' }, this.#field, this.#button),
      this.#wrong,
    );
    this.root.hidden = true;
    this.root.addEventListener('submit', (event) => {
      event.preventDefault();
      const token = this.#field.value.trim();
      this.#field.value = '';
      if (token !== '') onToken(token);
    });
  }

  /** Null hides it; else whether the last token was wrong. */
  show(asked: { wrong: boolean } | null): void {
    const opens = asked !== null && this.root.hidden;
    this.root.hidden = asked === null;
    setText(
      this.#wrong,
      asked?.wrong === true ? 'This token is not known here. Check it, or ask for a new one.' : '',
    );
    if (opens) this.#field.focus();
  }
}
