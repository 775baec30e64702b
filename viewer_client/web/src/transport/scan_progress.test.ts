// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { scanProgressOf } from './scan_progress';

const kScan = {
  state: 'sweep',
  age_s: 0.5,
  positions: 6,
  recorded: 2,
  left_out: 1,
  columns: 3,
  rows: 2,
  cells: '121003',
  pan_deg: [30, -30],
  tilt_deg: [10, -10],
  text: '',
  notes: 'pan 0.0 tilt 10.0: too few depth frames came\n',
  coverage: 0,
  triangles: 0,
};

describe("a scan's progress", () => {
  it('is read whole', () => {
    const { cells, notes, ...rest } = scanProgressOf(kScan);
    const { cells: _cells, notes: _notes, ...sent } = kScan;
    expect(rest).toEqual(sent);
    expect(cells).toEqual(['recorded', 'left_out', 'recorded', 'to_come', 'to_come', 'head']);
    expect(notes).toEqual(['pan 0.0 tilt 10.0: too few depth frames came']);
  });

  it('may have no map', () =>
    expect(scanProgressOf({ ...kScan, columns: 0, rows: 0, cells: '' }).cells).toEqual([]));

  it('is refused by the name of a field that is wrong', () => {
    for (const key of Object.keys(kScan))
      expect(() => scanProgressOf({ ...kScan, [key]: null }), key).toThrow(key);
    for (const cells of ['12100', '1210033', '121004', '12100x', [1, 2, 1, 0, 0, 3]])
      expect(() => scanProgressOf({ ...kScan, cells })).toThrow('cells');
    expect(() => scanProgressOf({ ...kScan, columns: 1e9 })).toThrow('cells');
    expect(() => scanProgressOf({ ...kScan, state: 'asleep' })).toThrow('state');
  });
});
