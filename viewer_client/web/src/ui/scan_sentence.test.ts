// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { ScanProgress } from '../transport/scan_progress';
import { scanSentence } from './scan_sentence';

const kScan: ScanProgress = {
  state: 'sweep',
  age_s: 0.4,
  positions: 16,
  recorded: 3,
  left_out: 0,
  columns: 2,
  rows: 1,
  cells: ['recorded', 'head'],
  pan_deg: [30, -30],
  tilt_deg: [0, 0],
  text: '',
  notes: [],
  coverage: 0,
  triangles: 0,
};

describe("a scan's sentence", () => {
  it('counts positions', () => {
    expect(scanSentence(kScan)).toEqual({ sentence: 'Sweeping the room: 3 of 16.', tone: 'busy' });
    expect(scanSentence({ ...kScan, left_out: 1 }).sentence).toContain('1 left out');
  });

  it('says that no head has been heard', () =>
    expect(scanSentence({ ...kScan, recorded: 0, cells: ['to_come', 'to_come'] }).sentence).toContain('waits'));

  it('names the step', () =>
    expect(scanSentence({ ...kScan, state: 'compute', text: 'register' }).sentence).toContain('register'));

  it('tells the result', () => {
    const done = { ...kScan, state: 'done', coverage: 0.9876, triangles: 132400 } as const;
    const { sentence, tone } = scanSentence(done);
    expect(sentence).toBe('The room is scanned: 98.8 % covered, 132,400 triangles.');
    expect(tone).toBe('live');
    expect(scanSentence({ ...done, left_out: 2 })).toMatchObject({ tone: 'warning' });
  });

  it('tells why it failed', () =>
    expect(scanSentence({ ...kScan, state: 'failed', text: 'no agent' })).toEqual({
      sentence: 'The scan failed: no agent',
      tone: 'alarm',
    }));

  it('is an alarm when the scan is silent, not when it has ended', () => {
    for (const state of ['sweep', 'compute'] as const) {
      const { sentence, tone } = scanSentence({ ...kScan, state, age_s: 12.3 });
      expect(sentence).toContain('silent for 12 s');
      expect(tone).toBe('alarm');
    }
    expect(scanSentence({ ...kScan, state: 'done', age_s: 12.3 }).sentence).not.toContain('silent');
  });
});
