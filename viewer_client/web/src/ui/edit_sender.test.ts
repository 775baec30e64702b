// SPDX-License-Identifier: Apache-2.0
import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import type { Edit, EditOp } from '../transport/edit';
import { EditSender } from './edit_sender';

let sent: Edit[];
let sender: EditSender;

beforeEach(() => {
  vi.useFakeTimers();
  sent = [];
  sender = new EditSender((edit) => sent.push(edit), Date.now);
});
afterEach(() => vi.useRealTimers());

function to(u: number): EditOp {
  return { op: 'move', object: 1, u, v: 0, on: 'floor' };
}

describe('the sender of edits', () => {
  it('sends at most 20 edits in any second of a drag, the newest each time, and the last one', () => {
    for (let step = 0; step <= 2000; step += 4) {
      sender.live(to(step));
      vi.advanceTimersByTime(4);
    }
    sender.settle(to(9999));
    expect(sent.length).toBeLessThanOrEqual(2 * 20 + 1);
    expect(sent.length).toBeGreaterThan(2 * 15);
    expect(sent[0]).toEqual({ type: 'edit', id: 1, ...to(0), live: true });
    expect(sent.at(-1)).toMatchObject({ u: 9999, live: false });
    vi.advanceTimersByTime(1000);
    expect(sent.at(-1)).toMatchObject({ u: 9999 });
    expect(sent.slice(0, -1).every((edit) => edit.live === true)).toBe(true);
  });

  it('sends the newest of what waited once the hand rests', () => {
    sender.live(to(1));
    sender.live(to(2));
    sender.live(to(3));
    expect(sent.length).toBe(1);
    vi.advanceTimersByTime(60);
    expect(sent.map((edit) => 'u' in edit && edit.u)).toEqual([1, 3]);
  });

  it('sends everything else at once, in order and without live', () => {
    sender.live(to(1));
    sender.live(to(2));
    sender.do({ op: 'undo' });
    expect(sent.map(({ id, op }) => `${id} ${op}`)).toEqual(['1 move', '2 move', '3 undo']);
    expect(sent[2]).toEqual({ type: 'edit', id: 3, op: 'undo' });
  });

  it('adds up the turns of a key that is held', () => {
    for (let press = 0; press < 10; ++press) {
      sender.turn(4, 15);
      vi.advanceTimersByTime(30);
    }
    vi.advanceTimersByTime(1000);
    expect(sent.length).toBeLessThanOrEqual(6);
    expect(sent.reduce((sum, edit) => sum + (edit.op === 'turn' ? edit.angle_deg : 0), 0)).toBe(150);
    sender.turn(4, 1);
    sender.turn(5, 1);
    sender.turn(5, 1);
    vi.advanceTimersByTime(1000);
    expect(sent.slice(-2)).toMatchObject([{ object: 4 }, { object: 5 }]);
  });
});
