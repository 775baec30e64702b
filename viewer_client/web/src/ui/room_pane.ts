// SPDX-License-Identifier: Apache-2.0
import type { Pinhole } from '../transport/control_message';
import type { Scene, Vector3 } from '../transport/scene';
import type { Viewpoint } from '../view/geometry';
import { Orbit } from '../view/orbit';
import type { FromRoom, Look, RoomCounts } from '../view/room_messages';
import { el, setText } from './dom';
import type { Editor } from './editor';
import { icon } from './icons';
import { kHead_px, type Rect } from './layout';
import { OrbitInput } from './orbit_input';
import { Pane } from './pane';
import { RoomLink } from './room_link';

// More pixels than this are not worth their time on a machine without a graphics card.
const kMostWidth_px = 1600;

export interface RoomPaneHandlers {
  /** Where the rig's camera is now. */
  onPose(T_scene_color: readonly number[]): void;
  /** `shown_px` has changed by itself. */
  onShownChange(): void;
}

/** The 3D pane: starts its worker when it may and is shown, keeps where it is looked at from, lets objects be dragged. */
export class RoomPane {
  readonly pane = new Pane({
    name: 'room',
    title: '3D',
    describes: 'Room, actor, objects and camera',
    keys: 'Arrow keys turn the view, with Shift they move it; plus and minus zoom.',
  });
  /** The session's end of the way that meshes come by. */
  readonly session_port: MessagePort;
  readonly #room_port: MessagePort;
  readonly #handlers: RoomPaneHandlers;
  readonly #orbit = new Orbit();
  readonly #follow_label = el('span', { text: 'Follow' });
  readonly #follow: HTMLButtonElement;
  #link: RoomLink | null = null;
  #may_start = false;
  /** Nothing can be drawn, now or for ever. */
  #troubled = false;
  #size = { width: 1, height: 1 };
  #scene: Scene | null = null;
  #pinhole: Pinhole | null = null;
  #counts: RoomCounts | null = null;

  constructor(editor: Editor, handlers: RoomPaneHandlers) {
    this.#handlers = handlers;
    const channel = new MessageChannel();
    this.session_port = channel.port1;
    this.#room_port = channel.port2;
    this.#follow = el(
      'button',
      {
        class: 'segment-button',
        testid: 'follow',
        attributes: { type: 'button', title: 'Go along with the camera (F)', 'aria-pressed': 'false' },
      },
      icon('follow'),
      this.#follow_label,
    );
    this.#follow.addEventListener('click', () => this.toggleFollow());
    this.pane.controls.append(this.#follow);
    this.pane.setReading('1 m grid');
    new OrbitInput(this.pane.frame, {
      press: (u, v) => editor.pressRoom(this.#viewpoint, u * this.#size.width, v * this.#size.height),
      drag: (u, v) => editor.dragRoom(this.#viewpoint, u * this.#size.width, v * this.#size.height),
      release: () => editor.release(),
      turn: (yaw_rad, pitch_rad) => this.#change(() => this.#orbit.turn(yaw_rad, pitch_rad)),
      pan: (right, down) => this.#change(() => this.#orbit.pan(right, down)),
      zoom: (factor) => this.#change(() => this.#orbit.zoom(factor)),
      centre: (u, v) => this.#link?.send({ type: 'touch', u, v }),
    });
  }

  get counts(): RoomCounts | null {
    return this.#counts;
  }

  /** Device pixels across of what is drawn; 0 while nothing can be: then no meshes are wanted either. */
  get shown_px(): number {
    return this.#link === null || this.#troubled ? 0 : this.pane.pane_px;
  }

  /** The worker's half a megabyte waits until the first picture stands. Says whether this was the first word. */
  allowStart(): boolean {
    const first = !this.#may_start;
    this.#may_start = true;
    return first;
  }

  place(rect: Rect): void {
    this.pane.place(rect, null);
    this.#size = { width: Math.max(1, Math.floor(rect.width)), height: Math.max(1, rect.height - kHead_px) };
    this.pane.frame.style.width = `${this.#size.width}px`;
    this.pane.frame.style.height = `${this.#size.height}px`;
  }

  /** To be called when the pane was placed, shown or hidden. */
  show(): void {
    if (this.#link === null && this.#may_start && this.pane.pane_px > 0) {
      this.#link = new RoomLink(this.pane.canvas, this.#room_port, this.#look, {
        onMessage: (message) => this.#receive(message),
        onDead: () => this.#trouble('The 3D view stopped. Reload the page to get it back.'),
      });
      if (this.#scene !== null) this.setScene(this.#scene);
      if (this.#pinhole !== null) this.setRig(this.#pinhole);
      return;
    }
    this.#link?.send({ type: 'look', look: this.#look });
  }

  setScene(scene: Scene): void {
    this.#scene = scene;
    this.#orbit.setUp(scene.up);
    this.#link?.send({ type: 'scene', scene });
    this.#sendLook();
  }

  setRig(pinhole: Pinhole): void {
    this.#pinhole = pinhole;
    this.#link?.send({ type: 'rig', pinhole });
  }

  select(id: number | null): void {
    this.#link?.send({ type: 'select', id });
  }

  toggleFollow(): void {
    this.#change(() => this.#orbit.toggleFollow());
  }

  get #viewpoint(): Viewpoint {
    return this.#orbit.viewpoint(this.#size.width, this.#size.height);
  }

  get #look(): Look {
    const hidden = document.hidden || this.pane.pane_px === 0;
    const { T_scene_camera, pinhole } = this.#viewpoint;
    const scale = Math.min(devicePixelRatio, kMostWidth_px / this.#size.width);
    return {
      width: hidden ? 0 : Math.max(1, Math.round(this.#size.width * scale)),
      height: Math.max(1, Math.round(this.#size.height * scale)),
      T_scene_eye: T_scene_camera,
      vertical_field_rad: 2 * Math.atan(pinhole.height / 2 / pinhole.fy),
    };
  }

  #change(move: () => void): void {
    move();
    this.#sendLook();
  }

  #sendLook(): void {
    this.#link?.send({ type: 'look', look: this.#look });
    this.#follow.setAttribute('aria-pressed', String(this.#orbit.follows));
    setText(this.#follow_label, this.#orbit.follows ? 'Following' : 'Follow');
  }

  #receive(message: FromRoom): void {
    switch (message.type) {
      case 'pose':
        this.#orbit.setCamera(message.T_scene_color);
        this.#sendLook();
        return this.#handlers.onPose(message.T_scene_color);
      case 'touched':
        return this.#centre(message.point);
      case 'counts':
        this.#counts = message.counts;
        return;
      case 'trouble':
        return this.#trouble(message.sentence);
    }
  }

  /** Empty: it is over. */
  #trouble(sentence: string): void {
    this.#troubled = sentence !== '';
    this.pane.setNote(sentence);
    this.#handlers.onShownChange();
  }

  #centre(point: Vector3 | null): void {
    if (point !== null) this.#change(() => this.#orbit.centre(point));
  }
}
