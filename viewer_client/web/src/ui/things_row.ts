// SPDX-License-Identifier: Apache-2.0
import { el, setText } from './dom';
import type { Editor } from './editor';
import { toolButton } from './tool_button';

const kAdopt = 'Make a thing left behind part of the room: click it in the program';

/** Things left behind in the set, which become the room's on command. Only a director has the command. */
export class ThingsRow {
  readonly root: HTMLElement;
  readonly #editor: Editor;
  readonly #count = el('span', { class: 'light-name', testid: 'things' });
  readonly #adopt = toolButton('add', 'adopt', kAdopt);
  readonly #forget = toolButton('trash', 'forget', 'Forget them: they are foreground again');

  constructor(editor: Editor) {
    this.#editor = editor;
    this.root = el(
      'section',
      { class: 'rail-part', attributes: { 'aria-label': 'Left behind' } },
      el(
        'div',
        { class: 'rail-head' },
        el('h2', { class: 'rail-title', text: 'Left behind' }),
        this.#count,
        this.#forget,
        this.#adopt,
      ),
    );
    this.#adopt.addEventListener('click', () =>
      editor.place(editor.placing?.what === 'adopt' ? null : { what: 'adopt' }),
    );
    this.#forget.addEventListener('click', () => editor.do({ op: 'forget' }));
  }

  update(): void {
    const { scene, may_edit, placing } = this.#editor;
    // In another place's picture nothing of his own room can be pointed at.
    this.root.hidden = !may_edit || scene?.avatar !== undefined;
    const adopted = scene?.adopted ?? 0;
    setText(this.#count, adopted === 0 ? '' : `${adopted} in the room`);
    this.#forget.hidden = adopted === 0;
    this.#adopt.setAttribute('aria-pressed', String(placing?.what === 'adopt'));
  }
}
