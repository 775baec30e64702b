// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { ClockOffset } from './clock_offset';

const kTrue_us = 123_456_789;

/** An exchange whose two ways take `out_us` and `back_us`. */
function exchange(clock: ClockOffset, sent_us: number, out_us: number, back_us: number): void {
  clock.addExchange(sent_us, sent_us + out_us + kTrue_us, sent_us + out_us + back_us);
}

describe('ClockOffset', () => {
  it('knows nothing before the first exchange', () => expect(new ClockOffset().offset_us).toBeNull());

  it('is exact when both ways take the same time', () => {
    const clock = new ClockOffset();
    exchange(clock, 1000, 400, 400);
    expect(clock.offset_us).toBe(kTrue_us);
    expect(clock.round_trip_us).toBe(800);
  });

  it('believes the smallest round trip, and is then off by at most its half', () => {
    const clock = new ClockOffset();
    exchange(clock, 1000, 9000, 100);
    exchange(clock, 20_000, 300, 200);
    exchange(clock, 40_000, 100, 50_000);
    expect(Math.abs((clock.offset_us ?? NaN) - kTrue_us)).toBeLessThanOrEqual(250);
    expect(clock.round_trip_us).toBe(500);
  });

  it('forgets, so that drift is followed', () => {
    const clock = new ClockOffset(2);
    exchange(clock, 0, 10, 10);
    clock.addExchange(1000, 1500 + kTrue_us + 7, 2000);
    clock.addExchange(3000, 3500 + kTrue_us + 7, 4000);
    expect(clock.offset_us).toBe(kTrue_us + 7);
  });

  it('takes no exchange that ended before it began', () => {
    const clock = new ClockOffset();
    clock.addExchange(100, 5, 99);
    expect(clock.offset_us).toBeNull();
  });
});
