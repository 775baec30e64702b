// SPDX-License-Identifier: Apache-2.0
import type { PictureSize } from '../view/messages';
import type { Editor } from './editor';

/** Clicks and drags in the program: selecting, placing, moving along the floor. */
export class ProgramInput {
  readonly #frame: HTMLElement;
  readonly #editor: Editor;
  readonly #size: () => PictureSize;
  /** The pointer that drags. */
  #pointer: number | null = null;

  constructor(frame: HTMLElement, editor: Editor, size: () => PictureSize) {
    this.#frame = frame;
    this.#editor = editor;
    this.#size = size;
    frame.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || this.#pointer !== null) return;
      if (!editor.pressProgram(...this.#pixel(event))) return;
      this.#pointer = event.pointerId;
      frame.setPointerCapture(event.pointerId);
    });
    frame.addEventListener('pointermove', (event) => {
      if (event.pointerId === this.#pointer) editor.dragProgram(...this.#pixel(event));
    });
    for (const name of ['pointerup', 'pointercancel'] as const)
      frame.addEventListener(name, (event) => this.#up(event));
    frame.addEventListener('keydown', (event) => this.#key(event));
  }

  /** Pixels of the picture, whose centres are whole numbers; the drag may leave it. */
  #pixel({ clientX, clientY }: MouseEvent): [number, number] {
    const box = this.#frame.getBoundingClientRect();
    const { width, height } = this.#size();
    const along = (position: number, length: number): number =>
      Math.min(length - 1, Math.max(0, position * length - 0.5));
    return [along((clientX - box.left) / box.width, width), along((clientY - box.top) / box.height, height)];
  }

  #up(event: PointerEvent): void {
    if (event.pointerId !== this.#pointer) return;
    this.#pointer = null;
    this.#editor.release();
  }

  /** Enter places what is to be placed at the depth probe, so that no pointer is needed. */
  #key(event: KeyboardEvent): void {
    if (event.key !== 'Enter' || this.#editor.placing === null) return;
    event.preventDefault();
    const mark = this.#frame.querySelector<HTMLElement>('.probe:not([hidden])');
    const part = (text: string | undefined): number => (Number.parseFloat(text ?? '') || 50) / 100;
    const { width, height } = this.#size();
    this.#editor.pressProgram(part(mark?.style.left) * width - 0.5, part(mark?.style.top) * height - 0.5);
  }
}
