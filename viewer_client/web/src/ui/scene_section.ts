// SPDX-License-Identifier: Apache-2.0
import { kNoAnimation, type Scene, type SceneObject } from '../transport/scene';
import { AddMenu } from './add_menu';
import { AvatarRow } from './avatar_row';
import { el, setText } from './dom';
import type { Editor } from './editor';
import { icon } from './icons';
import { LightList } from './light_list';
import { stepOf } from './nudge_keys';
import { ThingsRow } from './things_row';
import { toolButton } from './tool_button';

const kNoticeStays_ms = 6000;
interface Row {
  root: HTMLElement;
  name: HTMLElement;
  select: HTMLButtonElement;
  animation: HTMLSelectElement;
  hide: HTMLButtonElement;
  move: HTMLButtonElement;
  remove: HTMLButtonElement;
}

/** The scene in the rail: its objects, its lights, what may be added; undo, redo, save. A viewer sees no handles. */
export class SceneSection {
  readonly root: HTMLElement;
  /** What goes with it: lights, the actor elsewhere, things left behind. */
  readonly parts: readonly HTMLElement[];
  readonly #editor: Editor;
  readonly #add: AddMenu;
  readonly #lights: LightList;
  readonly #avatar: AvatarRow;
  readonly #things: ThingsRow;
  readonly #list = el('ul', { class: 'objects', testid: 'objects' });
  readonly #empty = el('p', { class: 'quiet' });
  readonly #tools: HTMLElement;
  readonly #undo = toolButton('undo', 'undo', 'Undo (Ctrl+Z)');
  readonly #redo = toolButton('redo', 'redo', 'Redo (Ctrl+Shift+Z)');
  readonly #save = el(
    'button',
    { class: 'save', testid: 'save', attributes: { type: 'button', title: 'Save the scene (Ctrl+S)' } },
    icon('save'),
    el('span', { text: 'Save' }),
  );
  readonly #unsaved = el('span', { class: 'unsaved', testid: 'unsaved', text: 'unsaved' });
  readonly #notice = el('p', {
    class: 'scene-notice',
    testid: 'scene-notice',
    attributes: { role: 'status' },
  });
  readonly #rows = new Map<number, Row>();
  #notice_timer: ReturnType<typeof setTimeout> | undefined;

  constructor(editor: Editor) {
    this.#editor = editor;
    this.#add = new AddMenu((file) => editor.place({ what: 'add', file }));
    this.#lights = new LightList(editor);
    this.#avatar = new AvatarRow(editor);
    this.#things = new ThingsRow(editor);
    this.parts = [this.#lights.root, this.#avatar.root, this.#things.root];
    this.#undo.addEventListener('click', () => editor.do({ op: 'undo' }));
    this.#redo.addEventListener('click', () => editor.do({ op: 'redo' }));
    this.#save.addEventListener('click', () => editor.do({ op: 'save' }));
    this.#tools = el('div', { class: 'scene-tools' }, this.#undo, this.#redo, this.#unsaved, this.#save);
    this.root = el(
      'section',
      { class: 'rail-part scene', testid: 'scene', attributes: { 'aria-label': 'Scene' } },
      el('div', { class: 'rail-head' }, el('h2', { class: 'rail-title', text: 'Scene' }), this.#add.root),
      this.#list,
      this.#empty,
      this.#notice,
      this.#tools,
    );
    this.#notice.hidden = true;
    this.update();
  }

  openAdd(): void {
    if (this.#editor.may_edit) this.#add.toggle();
  }

  /** Shows what the editor knows. */
  update(): void {
    const { scene, may_edit, placing } = this.#editor;
    this.#add.root.hidden = !may_edit;
    this.#tools.hidden = !may_edit;
    this.#empty.hidden = (scene?.objects.length ?? 0) > 0;
    const nothing = may_edit ? 'Nothing virtual yet: add an object.' : 'Nothing virtual is in the picture.';
    setText(this.#empty, scene === null ? 'Waiting for the scene...' : nothing);
    this.#lights.update();
    this.#avatar.update();
    this.#things.update();
    if (scene === null) return this.#showRows([]);
    this.#add.setModels(scene.models);
    this.#add.setPlacing(placing?.what === 'add');
    this.#undo.disabled = !scene.can_undo;
    this.#redo.disabled = !scene.can_redo;
    this.#save.disabled = !scene.unsaved;
    this.#unsaved.hidden = !scene.unsaved;
    this.#showRows(scene.objects);
  }

  /** A calm line: what another did, why an edit was refused. It goes away by itself. */
  tell(sentence: string, tone: 'quiet' | 'warning'): void {
    clearTimeout(this.#notice_timer);
    setText(this.#notice, sentence);
    this.#notice.dataset['tone'] = tone;
    this.#notice.hidden = false;
    this.#notice_timer = setTimeout(() => (this.#notice.hidden = true), kNoticeStays_ms);
  }

  #showRows(objects: Scene['objects']): void {
    const known = new Set(objects.map(({ id }) => id));
    for (const [id, row] of this.#rows) {
      if (known.has(id)) continue;
      row.root.remove();
      this.#rows.delete(id);
    }
    for (const object of objects) this.#showRow(object);
  }

  #showRow(object: SceneObject): void {
    const row = this.#rows.get(object.id) ?? this.#makeRow(object.id);
    const { may_edit, selected, placing } = this.#editor;
    const is_selected = selected?.id === object.id;
    setText(row.name, object.name);
    row.root.classList.toggle('selected', is_selected);
    row.root.classList.toggle('is-hidden', object.hidden);
    row.select.setAttribute('aria-pressed', String(is_selected));
    row.select.title = `${object.file}, ${object.triangles} triangles`;
    this.#showAnimations(row.animation, object);
    for (const button of [row.hide, row.move, row.remove]) button.hidden = !may_edit;
    row.hide.replaceChildren(icon(object.hidden ? 'hidden' : 'shown'));
    row.hide.setAttribute('aria-pressed', String(object.hidden));
    const hide = `${object.hidden ? 'Show' : 'Hide'} ${object.name}`;
    row.hide.title = hide;
    row.hide.setAttribute('aria-label', hide);
    const moving = placing?.what === 'move' && placing.object === object.id;
    row.move.setAttribute('aria-pressed', String(moving));
    row.move.setAttribute('aria-label', `Move ${object.name}`);
    row.remove.setAttribute('aria-label', `Delete ${object.name}`);
  }

  #showAnimations(list: HTMLSelectElement, { name, animations, animation }: SceneObject): void {
    list.hidden = animations === undefined || !this.#editor.may_edit;
    if (animations === undefined || animation === undefined) return;
    const names = [...animations, kNoAnimation];
    if (list.options.length !== names.length)
      list.replaceChildren(...names.map((each) => el('option', { text: each, attributes: { value: each } })));
    list.value = animation;
    list.title = `What ${name} plays`;
    list.setAttribute('aria-label', list.title);
  }

  #makeRow(id: number): Row {
    const name = el('span', { class: 'object-name' });
    const select = el(
      'button',
      { class: 'object-select', testid: `object-${id}`, attributes: { type: 'button' } },
      name,
    );
    const animation = el('select', { class: 'object-animation', testid: `animation-${id}` });
    const hide = toolButton('shown', `hide-${id}`, 'Hide');
    const move = toolButton('move', `move-${id}`, 'Move: click into the program, or use the arrow keys here');
    const remove = toolButton('trash', `delete-${id}`, 'Delete (Del)');
    const root = el('li', { class: 'object' }, select, animation, hide, move, remove);
    select.addEventListener('click', () => this.#editor.select(id));
    animation.addEventListener('change', () =>
      this.#editor.do({ op: 'animate', object: id, animation: animation.value }),
    );
    hide.addEventListener('click', () => {
      const hidden = this.#editor.scene?.objects.find((object) => object.id === id)?.hidden ?? false;
      this.#editor.do({ op: 'hide', object: id, hidden: !hidden });
    });
    move.addEventListener('click', () => {
      const placing = this.#editor.placing;
      const again = placing?.what === 'move' && placing.object === id;
      this.#editor.place(again ? null : { what: 'move', object: id });
    });
    move.addEventListener('keydown', (event) => this.#nudge(event, id));
    remove.addEventListener('click', () => this.#editor.do({ op: 'delete', object: id }));
    const row = { root, name, select, animation, hide, move, remove };
    this.#rows.set(id, row);
    this.#list.append(root);
    return row;
  }

  #nudge(event: KeyboardEvent, id: number): void {
    const step = stepOf(event);
    if (step === null || step.up !== 0) return;
    event.preventDefault();
    if (this.#editor.selected?.id !== id) this.#editor.select(id);
    this.#editor.nudge(step.right, step.away);
  }
}
