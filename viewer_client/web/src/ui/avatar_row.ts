// SPDX-License-Identifier: Apache-2.0
import { el, setText } from './dom';
import type { Editor } from './editor';
import { stepOf } from './nudge_keys';
import { toolButton } from './tool_button';

/** Where the actor stands in another space: turned by a slider, moved by keys. Not there where the scene has no avatar. */
export class AvatarRow {
  readonly root: HTMLElement;
  readonly #editor: Editor;
  readonly #place = el('span', { class: 'light-name', testid: 'avatar-place' });
  readonly #value = el('span', { class: 'light-value' });
  readonly #slider = el('input', {
    class: 'light-slider',
    testid: 'avatar-turn',
    attributes: { type: 'range', min: '-180', max: '180', step: '1', 'aria-label': 'Turn of the actor, degrees' },
  });
  readonly #move = toolButton('move', 'avatar-move', 'Move the actor: arrow keys, Page Up and Page Down here');
  #held = false;

  constructor(editor: Editor) {
    this.#editor = editor;
    this.root = el(
      'section',
      { class: 'rail-part', attributes: { 'aria-label': 'Actor' } },
      el('h2', { class: 'rail-title', text: 'Actor' }),
      el('div', { class: 'light avatar' }, this.#place, this.#slider, this.#value, this.#move),
    );
    this.#slider.addEventListener('input', () => {
      this.#held = true;
      editor.live({ op: 'avatar', turn_deg: Number(this.#slider.value) });
    });
    this.#slider.addEventListener('change', () => {
      this.#held = false;
      editor.settle({ op: 'avatar', turn_deg: Number(this.#slider.value) });
    });
    this.#slider.addEventListener('blur', () => (this.#held = false));
    this.#move.addEventListener('keydown', (event) => {
      const step = stepOf(event);
      if (step === null) return;
      event.preventDefault();
      editor.nudgeAvatar(step);
    });
  }

  update(): void {
    const { scene, may_edit } = this.#editor;
    const avatar = scene?.avatar ?? null;
    this.root.hidden = avatar === null;
    if (avatar === null) return;
    const [x, y] = avatar.position;
    setText(this.#place, `${x.toFixed(2)}, ${y.toFixed(2)} m`);
    setText(this.#value, `${Math.round(avatar.turn_deg)}\u00b0`);
    this.#slider.disabled = !may_edit;
    this.#move.hidden = !may_edit;
    if (!this.#held) this.#slider.value = String(halfTurns(avatar.turn_deg));
  }
}

/** -180 .. 180 of any angle. */
function halfTurns(angle_deg: number): number {
  return angle_deg - 360 * Math.round(angle_deg / 360);
}
