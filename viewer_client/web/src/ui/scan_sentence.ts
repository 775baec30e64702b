// SPDX-License-Identifier: Apache-2.0
import type { ScanProgress } from '../transport/scan_progress';
import { count, fixed, span } from './numbers';
import type { Tone } from './state_sentence';

/** A scan says something twice a second: one that missed six is not well. */
export const kSilentAfter_s = 3;

export interface ScanSentence {
  sentence: string;
  tone: Tone;
}

function leftOut({ left_out }: ScanProgress): string {
  return left_out === 0 ? '' : `, ${count(left_out)} left out`;
}

/** How a live scan goes, in words. */
export function scanSentence(scan: ScanProgress): ScanSentence {
  const { state, age_s, positions, recorded, left_out } = scan;
  if (state === 'failed') return { sentence: `The scan failed: ${scan.text}`, tone: 'alarm' };
  if (state === 'done') {
    const covered = `${fixed(100 * scan.coverage, 1)} % covered`;
    const sentence = `The room is scanned: ${covered}, ${count(scan.triangles)} triangles${leftOut(scan)}.`;
    return { sentence, tone: left_out === 0 ? 'live' : 'warning' };
  }
  if (age_s > kSilentAfter_s) {
    const sentence = `The scan has been silent for ${span(age_s)}. Look at the program that scans.`;
    return { sentence, tone: 'alarm' };
  }
  if (state === 'compute') {
    const sentence = `Computing the room: ${scan.text === '' ? 'begins' : scan.text}${leftOut(scan)}.`;
    return { sentence, tone: 'busy' };
  }
  const begun = recorded + left_out > 0 || scan.cells.length === 0 || scan.cells.includes('head');
  if (!begun) return { sentence: 'The scan waits for the head.', tone: 'busy' };
  const sentence = `Sweeping the room: ${count(recorded)} of ${count(positions)}${leftOut(scan)}.`;
  return { sentence, tone: 'busy' };
}
