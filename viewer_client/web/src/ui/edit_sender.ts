// SPDX-License-Identifier: Apache-2.0
import type { Edit, EditOp } from '../transport/edit';

// The server closes the connection of who says more than 20 things a second: a little less leaves room for pings.
const kLiveEvery_ms = 60;
const kMostId = 2 ** 31 - 1;

function sameTarget(a: EditOp, b: EditOp): boolean {
  if (a.op === 'move') return b.op === 'move' && a.object === b.object;
  if (a.op === 'light') return b.op === 'light' && a.light === b.light;
  return a.op === 'avatar' && b.op === 'avatar';
}

/** Numbers edits, and sends what a hand does in the middle of a drag no oftener than the server wants to hear it. */
export class EditSender {
  readonly #send: (edit: Edit) => void;
  readonly #now: () => number;
  #next_id = 0;
  #sent_ms = -Infinity;
  #waiting: EditOp | null = null;
  #waiting_live = false;
  #timer: ReturnType<typeof setTimeout> | undefined;

  constructor(send: (edit: Edit) => void, now = (): number => performance.now()) {
    this.#send = send;
    this.#now = now;
  }

  /** When the last edit went out, on the clock that was given. */
  get sent_ms(): number {
    return this.#sent_ms;
  }

  /** At once, one step of undo. */
  do(op: EditOp): void {
    this.#flush();
    this.#post({ ...op });
  }

  /** The middle of a drag: of what comes too fast only the newest is sent. */
  live(op: EditOp): void {
    if (this.#waiting !== null && !this.#waiting_live) this.#flush();
    this.#wait(op, true);
  }

  /** The end of a drag: at once, whatever waited is overtaken. */
  settle(op: EditOp): void {
    if (this.#waiting_live) this.#forget();
    this.#flush();
    this.#post({ ...op, live: false });
  }

  /** A key that is held turns by the sum of its steps. */
  turn(object: number, angle_deg: number): void {
    const waiting = this.#waiting;
    const same = waiting !== null && waiting.op === 'turn' && waiting.object === object;
    if (!same) this.#flush();
    this.#wait({ op: 'turn', object, angle_deg: angle_deg + (same ? waiting.angle_deg : 0) }, false);
  }

  /** A key that is held leads something along: of what comes too fast only the newest is sent. */
  lead(op: EditOp): void {
    if (this.#waiting !== null && !sameTarget(this.#waiting, op)) this.#flush();
    this.#wait(op, false);
  }

  #wait(op: EditOp, live: boolean): void {
    this.#waiting = op;
    this.#waiting_live = live;
    const wait_ms = this.#sent_ms + kLiveEvery_ms - this.#now();
    if (wait_ms <= 0) this.#flush();
    else this.#timer ??= setTimeout(() => this.#flush(), wait_ms);
  }

  #flush(): void {
    const waiting = this.#waiting;
    const live = this.#waiting_live;
    this.#forget();
    if (waiting !== null) this.#post(live ? { ...waiting, live } : waiting);
  }

  #forget(): void {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    this.#waiting = null;
    this.#waiting_live = false;
  }

  #post(op: EditOp & { live?: boolean }): void {
    this.#sent_ms = this.#now();
    this.#next_id = this.#next_id === kMostId ? 1 : this.#next_id + 1;
    this.#send({ type: 'edit', id: this.#next_id, ...op });
  }
}
