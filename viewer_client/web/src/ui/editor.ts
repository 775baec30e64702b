// SPDX-License-Identifier: Apache-2.0
import type { Pinhole, Role } from '../transport/control_message';
import type { EditOp } from '../transport/edit';
import type { Scene, SceneObject, Vector3 } from '../transport/scene';
import {
  add,
  cross,
  dot,
  horizontal,
  kIdentityPose,
  meetPlane,
  normalize,
  project,
  rayThrough,
  rotate,
  scale,
  sub,
  type Pose,
  type Viewpoint,
} from '../view/geometry';
import { pickObject } from '../view/pick';
import type { EditSender } from './edit_sender';
import { changeOf } from './scene_change';

/** What the next click into the program does. */
export type Placing = { what: 'add'; file: string } | { what: 'move'; object: number };

export interface EditorHandlers {
  /** Scene, selection, role or what is being placed has changed. */
  onChange(): void;
  onNotice(sentence: string, tone: 'quiet' | 'warning'): void;
}

/** A drag that has begun: which object, and how the pointer stood to its base. */
interface Drag {
  object: number;
  from: { u: number; v: number };
  base: { u: number; v: number };
  moved: boolean;
  last: EditOp | null;
}

// What moves less than this is a click.
const kDragFrom_px = 4;
// A change that comes so soon after an own edit is its echo.
const kEcho_ms = 1500;

/** The scene as the server last told it, what is selected in it, and what a director's hand does to it. */
export class Editor {
  readonly #sender: EditSender;
  readonly #handlers: EditorHandlers;
  readonly #now: () => number;
  #scene: Scene | null = null;
  #role: Role = 'viewer';
  #user = '';
  #pinhole: Pinhole | null = null;
  #T_scene_color: Pose | null = null;
  #selected: number | null = null;
  #placing: Placing | null = null;
  #drag: Drag | null = null;

  constructor(sender: EditSender, handlers: EditorHandlers, now = (): number => performance.now()) {
    this.#sender = sender;
    this.#handlers = handlers;
    this.#now = now;
  }

  get scene(): Scene | null {
    return this.#scene;
  }

  get may_edit(): boolean {
    return this.#role === 'director' && this.#scene !== null;
  }

  get selected(): SceneObject | null {
    return this.#object(this.#selected);
  }

  get placing(): Placing | null {
    return this.#placing;
  }

  /** The rig's camera; null while its lens or its pose is not known. */
  get program_view(): Viewpoint | null {
    if (this.#pinhole === null) return null;
    // A scene in the camera's frame stands still with it until a picture says otherwise.
    const T_scene_camera = this.#T_scene_color ?? (this.#scene?.frame === 'camera' ? kIdentityPose : null);
    return T_scene_camera === null ? null : { T_scene_camera, pinhole: this.#pinhole };
  }

  setHello(role: Role, pinhole: Pinhole | null): void {
    this.#role = role;
    this.#pinhole = pinhole;
    if (role !== 'director') this.#stop();
    this.#handlers.onChange();
  }

  setUser(user: string): void {
    this.#user = user;
  }

  setPose(T_scene_color: Pose): void {
    this.#T_scene_color = T_scene_color;
  }

  setScene(scene: Scene): void {
    const before = this.#scene;
    this.#scene = scene;
    if (this.#object(this.#selected) === null) this.#selected = null;
    if (this.#drag !== null && this.#object(this.#drag.object) === null) this.#drag = null;
    if (before !== null) this.#tellChange(before, scene);
    this.#handlers.onChange();
  }

  /** The connection is gone: what was known of the scene belongs to it. */
  forget(): void {
    this.#scene = null;
    this.#T_scene_color = null;
    this.#stop();
    this.#handlers.onChange();
  }

  select(id: number | null): void {
    this.#selected = id;
    this.#handlers.onChange();
  }

  /** Arms the next click into the program; null disarms it. */
  place(placing: Placing | null): void {
    this.#placing = this.may_edit ? placing : null;
    if (placing?.what === 'move') this.#selected = placing.object;
    this.#handlers.onChange();
  }

  do(op: EditOp): void {
    if (this.may_edit) this.#sender.do(op);
  }

  live(op: EditOp): void {
    if (this.may_edit) this.#sender.live(op);
  }

  settle(op: EditOp): void {
    if (this.may_edit) this.#sender.settle(op);
  }

  /** Does something with the selected object; says so when there is none. */
  doSelected(make: (object: SceneObject) => EditOp): void {
    const object = this.selected;
    if (!this.may_edit) return;
    if (object === null) return this.#handlers.onNotice('Select an object first.', 'quiet');
    this.#sender.do(make(object));
  }

  turn(angle_deg: number): void {
    if (this.may_edit && this.#selected !== null) this.#sender.turn(this.#selected, angle_deg);
  }

  /** Moves the selected object on its own plane, right of and away from the camera, in metres. */
  nudge(right_m: number, away_m: number): void {
    const [object, up] = [this.selected, this.#scene?.up];
    if (object === null || up === undefined || !this.may_edit) return;
    const z = rotate(this.program_view?.T_scene_camera ?? kIdentityPose, [0, 0, 1]);
    const flat = sub(z, scale(up, dot(z, up)));
    // A camera that looks straight down has no "away": then any horizontal direction is one.
    const away = normalize(Math.hypot(...flat) > 1e-3 ? flat : horizontal(up)[0]);
    const right = cross(away, up);
    const position = add(object.base, add(scale(right, right_m), scale(away, away_m)));
    this.#sender.do({ op: 'move', object: object.id, position });
  }

  /** A press into the program at a pixel of the picture. Says whether the pointer now drags. */
  pressProgram(u: number, v: number): boolean {
    const placing = this.#placing;
    if (placing !== null) {
      this.#placing = null;
      this.do(
        placing.what === 'add'
          ? { op: 'add', file: placing.file, u, v }
          : { op: 'move', object: placing.object, u, v },
      );
      this.#handlers.onChange();
      return false;
    }
    const view = this.program_view;
    if (view === null) {
      // Nothing can be picked without the camera's pose, but what is selected can be led by the hand.
      if (this.#selected !== null && this.may_edit) this.#begin(this.#selected, u, v, { u, v });
      return this.#drag !== null;
    }
    if (this.#take(view, u, v)) return this.#drag !== null;
    this.select(null);
    return false;
  }

  dragProgram(u: number, v: number): void {
    this.#continue(u, v, (object, at) => ({ op: 'move', object, u: at.u, v: at.v, on: 'floor' }));
  }

  /** A press into the 3D pane; says whether the pointer now drags an object: else it turns the view. */
  pressRoom(view: Viewpoint, u: number, v: number): boolean {
    return this.#take(view, u, v) && this.#drag !== null;
  }

  dragRoom(view: Viewpoint, u: number, v: number): void {
    this.#continue(u, v, (id, at) => {
      const object = this.#object(id);
      const up = this.#scene?.up;
      if (object === null || up === undefined) return null;
      const position: Vector3 | null = meetPlane(rayThrough(view, at.u, at.v), up, object.base);
      return position === null ? null : { op: 'move', object: id, position };
    });
  }

  /** The pointer was lifted: the drag's last edit is its step of undo. */
  release(): void {
    const drag = this.#drag;
    this.#drag = null;
    if (drag !== null && drag.last !== null) this.#sender.settle(drag.last);
  }

  /** Selects what lies under the pixel, and begins to drag it where that is allowed. False: nothing lies there. */
  #take(view: Viewpoint, u: number, v: number): boolean {
    const object = pickObject(this.#scene?.objects ?? [], view, u, v);
    if (object === null) return false;
    this.select(object.id);
    if (this.may_edit) this.#begin(object.id, u, v, project(view, object.base) ?? { u, v });
    return true;
  }

  #begin(object: number, u: number, v: number, base: { u: number; v: number }): void {
    this.#drag = { object, from: { u, v }, base, moved: false, last: null };
  }

  #continue(
    u: number,
    v: number,
    edit: (object: number, base: { u: number; v: number }) => EditOp | null,
  ): void {
    const drag = this.#drag;
    if (drag === null) return;
    const [du, dv] = [u - drag.from.u, v - drag.from.v];
    if (!drag.moved && Math.hypot(du, dv) < kDragFrom_px) return;
    drag.moved = true;
    // The object keeps standing to the pointer as it stood when it was taken.
    const op = edit(drag.object, { u: drag.base.u + du, v: drag.base.v + dv });
    if (op === null) return;
    drag.last = op;
    this.#sender.live(op);
  }

  #object(id: number | null): SceneObject | null {
    return this.#scene?.objects.find((object) => object.id === id) ?? null;
  }

  #stop(): void {
    this.#placing = null;
    this.#drag = null;
  }

  /** What another director did is said with his name; one's own edits are seen. */
  #tellChange(before: Scene, after: Scene): void {
    const recent = this.#now() - this.#sender.sent_ms < kEcho_ms;
    if (recent && (after.by === '' || after.by === this.#user || this.#user === '')) return;
    const change = changeOf(before, after);
    if (change === null) return;
    this.#handlers.onNotice(`${after.by === '' ? 'Another director' : after.by} ${change}`, 'quiet');
  }
}
