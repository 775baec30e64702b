// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { MedianMeter, RateMeter } from './meters';

describe('RateMeter', () => {
  it('measures pictures that come evenly, right after the first second too', () => {
    const meter = new RateMeter(2000);
    for (let index = 0; index <= 30; ++index) meter.add(index * (1000 / 30));
    expect(meter.perSecond(1000)).toBeCloseTo(30, 6);
  });

  it('falls to nothing when nothing comes', () => {
    const meter = new RateMeter(2000);
    for (let index = 0; index < 30; ++index) meter.add(index * 33);
    expect(meter.perSecond(10_000)).toBe(0);
  });

  it('does not make a storm of the first two pictures', () => {
    const meter = new RateMeter(2000);
    meter.add(0);
    meter.add(1);
    expect(meter.perSecond(1)).toBe(2);
  });
});

describe('MedianMeter', () => {
  it('is not moved by one late picture', () => {
    const meter = new MedianMeter(5);
    expect(meter.median).toBeNull();
    for (const value of [9, 50, 51, 52, 53, 9000]) meter.add(value);
    expect(meter.median).toBe(52);
  });
});
