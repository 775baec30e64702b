// SPDX-License-Identifier: Apache-2.0
import type { SceneLight } from '../transport/scene';
import { el, setText } from './dom';
import type { Editor } from './editor';
import { hexOfLinear, intensityAt, linearOfHex, sliderAt, kSliderSteps } from './light_values';
import { stepOf } from './nudge_keys';
import { toolButton } from './tool_button';

interface Row {
  root: HTMLElement;
  name: HTMLElement;
  value: HTMLElement;
  slider: HTMLInputElement;
  color: HTMLInputElement;
  move: HTMLButtonElement;
}

/** The lights: how bright, in which colour, where. What a hand holds is not moved by what the server says meanwhile. */
export class LightList {
  readonly root: HTMLElement;
  readonly #editor: Editor;
  readonly #list = el('ul', { class: 'lights', testid: 'lights' });
  readonly #rows = new Map<number, Row>();
  #held: HTMLInputElement | null = null;

  constructor(editor: Editor) {
    this.#editor = editor;
    this.root = el(
      'section',
      { class: 'rail-part', attributes: { 'aria-label': 'Lights' } },
      el('h2', { class: 'rail-title', text: 'Lights' }),
      this.#list,
    );
  }

  update(): void {
    const lights = this.#editor.scene?.lights ?? [];
    this.root.hidden = lights.length === 0;
    const known = new Set(lights.map(({ id }) => id));
    for (const [id, row] of this.#rows) {
      if (known.has(id)) continue;
      row.root.remove();
      this.#rows.delete(id);
    }
    for (const light of lights) this.#show(light);
  }

  #show(light: SceneLight): void {
    const row = this.#rows.get(light.id) ?? this.#make(light.id);
    const { may_edit } = this.#editor;
    setText(row.name, light.name);
    setText(row.value, light.intensity.toFixed(light.intensity < 10 ? 2 : 1));
    const move =
      light.kind === 'directional'
        ? `Turn ${light.name}: arrow keys here`
        : `Move ${light.name}: drag it in 3D, or arrow keys, Page Up and Page Down here`;
    row.move.title = move;
    row.move.setAttribute('aria-label', move);
    row.move.hidden = !may_edit;
    row.slider.disabled = !may_edit;
    row.color.disabled = !may_edit;
    row.slider.setAttribute('aria-label', `Brightness of ${light.name}`);
    row.color.setAttribute('aria-label', `Colour of ${light.name}`);
    if (this.#held !== row.slider) row.slider.value = String(sliderAt(light.intensity));
    if (this.#held !== row.color) row.color.value = hexOfLinear(light.color);
  }

  #make(id: number): Row {
    const name = el('span', { class: 'light-name' });
    const value = el('span', { class: 'light-value' });
    const slider = el('input', {
      class: 'light-slider',
      testid: `light-${id}`,
      attributes: { type: 'range', min: '0', max: String(kSliderSteps), step: '1' },
    });
    const color = el('input', {
      class: 'light-color',
      testid: `light-color-${id}`,
      attributes: { type: 'color' },
    });
    this.#listen(slider, () => ({ light: id, intensity: intensityAt(Number(slider.value)) }));
    this.#listen(color, () => ({ light: id, color: linearOfHex(color.value) }));
    const move = toolButton('move', `light-move-${id}`, 'Move');
    move.addEventListener('keydown', (event) => {
      const step = stepOf(event);
      if (step === null) return;
      event.preventDefault();
      this.#editor.nudgeLight(id, step);
    });
    const root = el('li', { class: 'light' }, name, slider, value, color, move);
    const row = { root, name, value, slider, color, move };
    this.#rows.set(id, row);
    this.#list.append(root);
    return row;
  }

  #listen(
    input: HTMLInputElement,
    change: () => { light: number; intensity?: number; color?: SceneLight['color'] },
  ): void {
    input.addEventListener('input', () => {
      this.#held = input;
      this.#editor.live({ op: 'light', ...change() });
    });
    input.addEventListener('change', () => {
      this.#held = null;
      this.#editor.settle({ op: 'light', ...change() });
    });
    input.addEventListener('blur', () => (this.#held = null));
  }
}
