// SPDX-License-Identifier: Apache-2.0
import type { Pinhole, Role } from '../transport/control_message';
import type { EditOp } from '../transport/edit';
import type { Scene, SceneLight, SceneObject, Vector3 } from '../transport/scene';
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
  turned,
  unproject,
  type Pose,
  type Viewpoint,
} from '../view/geometry';
import { pickLight, pickObject } from '../view/pick';
import type { EditSender } from './edit_sender';
import type { Step } from './nudge_keys';
import { changeOf } from './scene_change';

/** What the next click into the program does. */
export type Placing = { what: 'add'; file: string } | { what: 'move'; object: number } | { what: 'adopt' };

export interface EditorHandlers {
  /** Scene, selection, role or what is being placed has changed. */
  onChange(): void;
  onNotice(sentence: string, tone: 'quiet' | 'warning'): void;
}

/** A drag that has begun: of what, and how the pointer stood to its base. */
interface Drag {
  what: 'object' | 'light';
  id: number;
  from: { u: number; v: number };
  base: { u: number; v: number };
  moved: boolean;
  last: EditOp | null;
}

interface Led {
  what: 'object' | 'light' | 'avatar';
  id: number;
  position: Vector3;
  at_ms: number;
}

// What moves less than this is a click.
const kDragFrom_px = 4;
// A change that comes so soon after an own edit is its echo.
const kEcho_ms = 1500;
// Steps that follow each other so soon go on from the last one, whatever the server has told meanwhile.
const kSteps_ms = 1000;

function opOf(placing: Placing, u: number, v: number): EditOp {
  switch (placing.what) {
    case 'add':
      return { op: 'add', file: placing.file, u, v };
    case 'move':
      return { op: 'move', object: placing.object, u, v };
    case 'adopt':
      return { op: 'adopt', u, v };
  }
}

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
  /** Where the last key led something. */
  #led: Led | null = null;

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
    if (this.#drag !== null && !this.#exists(this.#drag)) this.#drag = null;
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
    this.#led = null;
    if (this.may_edit) this.#sender.do(op);
  }

  live(op: EditOp): void {
    this.#led = null;
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
    const object = this.selected;
    if (object === null) return;
    this.#lead('object', object.id, (last) => add(last ?? object.base, this.#step(right_m, away_m)));
  }

  /** The same of a light, which also goes up. One from far away is turned, clockwise to the right: a metre is a radian. */
  nudgeLight(id: number, { right, away, up }: Step): void {
    const [light, scene] = [this.#light(id), this.#scene];
    if (light === null || scene === null) return;
    this.#lead('light', id, (last) => {
      const from = last ?? light.position;
      if (light.kind === 'directional') return turned(from, -right, away + up, scene.up);
      return add(from, add(this.#step(right, away), scale(scene.up, up)));
    });
  }

  /** Moves the actor who stands in another space. */
  nudgeAvatar({ right, away, up }: Step): void {
    const scene = this.#scene;
    const avatar = scene?.avatar;
    if (scene === null || avatar === undefined) return;
    const step = add(this.#step(right, away), scale(scene.up, up));
    this.#lead('avatar', 0, (last) => add(last ?? avatar.position, step));
  }

  /** A press into the program at a pixel of the picture. Says whether the pointer now drags. */
  pressProgram(u: number, v: number): boolean {
    const placing = this.#placing;
    if (placing !== null) {
      this.#placing = null;
      this.do(opOf(placing, u, v));
      this.#handlers.onChange();
      return false;
    }
    const view = this.program_view;
    if (view === null) {
      // Nothing can be picked without the camera's pose, but what is selected can be led by the hand.
      if (this.#selected !== null && this.may_edit)
        this.#begin('object', this.#selected, u, v, { u, v });
      return this.#drag !== null;
    }
    if (this.#take(view, u, v)) return this.#drag !== null;
    this.select(null);
    return false;
  }

  dragProgram(u: number, v: number): void {
    this.#continue(u, v, (object, at) => ({ op: 'move', object, u: at.u, v: at.v, on: 'floor' }));
  }

  /** A press into the 3D pane; says whether the pointer now drags a light or an object: else it turns the view. */
  pressRoom(view: Viewpoint, u: number, v: number): boolean {
    const light = this.may_edit ? pickLight(this.#scene?.lights ?? [], view, u, v) : null;
    if (light === null) return this.#take(view, u, v) && this.#drag !== null;
    this.#begin('light', light.id, u, v, project(view, light.position) ?? { u, v });
    return true;
  }

  /** An object moves on the horizontal plane through its base, a light at its distance from the eye. */
  dragRoom(view: Viewpoint, u: number, v: number): void {
    if (this.#drag?.what === 'light') {
      this.#continue(u, v, (id, at) => {
        const z_m = project(view, this.#light(id)?.position ?? [0, 0, 0])?.z_m;
        return z_m === undefined ? null : { op: 'light', light: id, position: unproject(view, at, z_m) };
      });
      return;
    }
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
    if (this.may_edit) this.#begin('object', object.id, u, v, project(view, object.base) ?? { u, v });
    return true;
  }

  #begin(
    what: Drag['what'],
    id: number,
    u: number,
    v: number,
    base: { u: number; v: number },
  ): void {
    this.#drag = { what, id, from: { u, v }, base, moved: false, last: null };
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
    // It keeps standing to the pointer as it stood when it was taken.
    const op = edit(drag.id, { u: drag.base.u + du, v: drag.base.v + dv });
    if (op === null) return;
    drag.last = op;
    this.#sender.live(op);
  }

  #object(id: number | null): SceneObject | null {
    return this.#scene?.objects.find((object) => object.id === id) ?? null;
  }

  #light(id: number): SceneLight | null {
    return this.#scene?.lights.find((light) => light.id === id) ?? null;
  }

  #exists({ what, id }: Drag): boolean {
    return (what === 'object' ? this.#object(id) : this.#light(id)) !== null;
  }

  /** `to`: where something goes from where the last key led it; null: from where it is. */
  #lead(what: Led['what'], id: number, to: (last: Vector3 | null) => Vector3): void {
    if (!this.may_edit) return;
    const [led, at_ms] = [this.#led, this.#now()];
    const goes_on = led?.what === what && led.id === id && at_ms - led.at_ms < kSteps_ms;
    const position = to(goes_on ? led.position : null);
    this.#led = { what, id, position, at_ms };
    const ops = {
      object: { op: 'move', object: id, position },
      light: { op: 'light', light: id, position },
      avatar: { op: 'avatar', position },
    } as const;
    this.#sender.lead(ops[what]);
  }

  /** A horizontal step, right of and away from the camera. */
  #step(right_m: number, away_m: number): Vector3 {
    const up = this.#scene?.up ?? [0, 0, 1];
    const z = rotate(this.program_view?.T_scene_camera ?? kIdentityPose, [0, 0, 1]);
    const flat = sub(z, scale(up, dot(z, up)));
    // A camera that looks straight down has no "away": then any horizontal direction is one.
    const away = normalize(Math.hypot(...flat) > 1e-3 ? flat : horizontal(up)[0]);
    return add(scale(cross(away, up), right_m), scale(away, away_m));
  }

  #stop(): void {
    this.#placing = null;
    this.#drag = null;
    this.#led = null;
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
