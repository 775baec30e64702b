// SPDX-License-Identifier: Apache-2.0

/** Places are 0..1 from the pane's left and upper edge. */
export interface OrbitHandlers {
  /** Says whether an object was taken hold of: then the pointer drags it, else it turns the view. */
  press(u: number, v: number): boolean;
  drag(u: number, v: number): void;
  release(): void;
  turn(yaw_rad: number, pitch_rad: number): void;
  /** In parts of the pane's shorter side. */
  pan(right: number, down: number): void;
  /** Above 1 goes away. */
  zoom(factor: number): void;
  centre(u: number, v: number): void;
}

const kTurnPerPane_rad = Math.PI;
const kKeyTurn_rad = Math.PI / 24;
const kKeyPan = 0.05;
const kKeyZoom = 1.15;
const kWheelZoom = 1.0015;
const kArrows: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

interface Finger {
  x: number;
  y: number;
}

type Hold = 'object' | 'turn' | 'pan';

/** Mouse, touch and keys over the 3D pane: one finger turns or drags, two move and zoom, the wheel zooms. */
export class OrbitInput {
  readonly #frame: HTMLElement;
  readonly #handlers: OrbitHandlers;
  readonly #fingers = new Map<number, Finger>();
  #hold: Hold | null = null;

  constructor(frame: HTMLElement, handlers: OrbitHandlers) {
    this.#frame = frame;
    this.#handlers = handlers;
    frame.addEventListener('pointerdown', (event) => this.#down(event));
    frame.addEventListener('pointermove', (event) => this.#move(event));
    for (const name of ['pointerup', 'pointercancel'] as const)
      frame.addEventListener(name, (event) => this.#up(event));
    frame.addEventListener('contextmenu', (event) => event.preventDefault());
    frame.addEventListener('wheel', (event) => this.#wheel(event), { passive: false });
    frame.addEventListener('dblclick', (event) => handlers.centre(...this.#place(event)));
    frame.addEventListener('keydown', (event) => this.#key(event));
  }

  #place({ clientX, clientY }: MouseEvent): [number, number] {
    const box = this.#frame.getBoundingClientRect();
    return [(clientX - box.left) / box.width, (clientY - box.top) / box.height];
  }

  #down(event: PointerEvent): void {
    this.#frame.setPointerCapture(event.pointerId);
    this.#fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.#fingers.size > 1) {
      if (this.#hold === 'object') this.#handlers.release();
      this.#hold = 'pan';
      return;
    }
    const pans = event.button !== 0 || event.shiftKey;
    if (!pans && this.#handlers.press(...this.#place(event))) this.#hold = 'object';
    else this.#hold = pans ? 'pan' : 'turn';
  }

  #move(event: PointerEvent): void {
    const before = this.#fingers.get(event.pointerId);
    if (before === undefined) return;
    const now = { x: event.clientX, y: event.clientY };
    const spread = this.#spread;
    this.#fingers.set(event.pointerId, now);
    if (this.#hold === 'object') return this.#handlers.drag(...this.#place(event));
    const side = Math.max(1, Math.min(this.#frame.clientWidth, this.#frame.clientHeight));
    // Each of two fingers does half of what both do together.
    const share = this.#fingers.size * side;
    const [right, down] = [(now.x - before.x) / share, (now.y - before.y) / share];
    if (this.#hold === 'turn') this.#handlers.turn(-right * kTurnPerPane_rad, down * kTurnPerPane_rad);
    else this.#handlers.pan(right, down);
    if (spread > 0 && this.#spread > 0) this.#handlers.zoom(spread / this.#spread);
  }

  #up(event: PointerEvent): void {
    if (!this.#fingers.delete(event.pointerId)) return;
    if (this.#hold === 'object') this.#handlers.release();
    // The finger that stays goes on moving the view; it does not suddenly turn it.
    if (this.#fingers.size === 0 || this.#hold === 'object') this.#hold = null;
  }

  /** Distance of the first two fingers; 0 with fewer. */
  get #spread(): number {
    const [a, b] = [...this.#fingers.values()];
    return a === undefined || b === undefined ? 0 : Math.hypot(a.x - b.x, a.y - b.y);
  }

  #wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    this.#handlers.zoom(kWheelZoom ** Math.max(-500, Math.min(500, event.deltaY * lines)));
  }

  #key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const arrow = kArrows[event.key];
    if (arrow !== undefined) {
      if (event.shiftKey) this.#handlers.pan(-arrow[0] * kKeyPan, -arrow[1] * kKeyPan);
      else this.#handlers.turn(arrow[0] * kKeyTurn_rad, -arrow[1] * kKeyTurn_rad);
    } else if (event.key === '+' || event.key === '=') this.#handlers.zoom(1 / kKeyZoom);
    else if (event.key === '-') this.#handlers.zoom(kKeyZoom);
    else return;
    event.preventDefault();
  }
}
