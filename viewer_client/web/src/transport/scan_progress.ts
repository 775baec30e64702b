// SPDX-License-Identifier: Apache-2.0
import { FieldError, amountAt, choiceAt, numbersAt, textAt, type JsonRecord } from './json_fields';

export const kScanStates = ['sweep', 'compute', 'done', 'failed'] as const;
export const kScanCells = ['to_come', 'recorded', 'left_out', 'head'] as const;
export type ScanCell = (typeof kScanCells)[number];

/** SPEC 4.2 `stats.scan`: a live scan of the room. */
export interface ScanProgress {
  state: (typeof kScanStates)[number];
  /** Since its last message. */
  age_s: number;
  positions: number;
  recorded: number;
  left_out: number;
  /** The sweep as the head sees it; 0 x 0: too many positions to show. */
  columns: number;
  rows: number;
  /** Row by row from the top, each from the left. */
  cells: ScanCell[];
  /** Of the first column and the last. */
  pan_deg: number[];
  /** Of the first row and the last. */
  tilt_deg: number[];
  /** The step at work, or why it failed. */
  text: string;
  /** What was left out and why. */
  notes: string[];
  /** 0..1 of the swept directions, when done. */
  coverage: number;
  triangles: number;
}

function cellsAt(record: JsonRecord, key: string, cells: number): ScanCell[] {
  const digits = textAt(record, key);
  if (digits.length !== cells || !/^[0-3]*$/.test(digits))
    throw new FieldError(`${key} is not ${cells} digits 0 to 3`);
  return [...digits].map((digit) => kScanCells[Number(digit)] ?? 'to_come');
}

/** Throws `FieldError` naming the field. */
export function scanProgressOf(record: JsonRecord): ScanProgress {
  const columns = amountAt(record, 'columns');
  const rows = amountAt(record, 'rows');
  return {
    state: choiceAt(record, 'state', kScanStates),
    age_s: amountAt(record, 'age_s'),
    positions: amountAt(record, 'positions'),
    recorded: amountAt(record, 'recorded'),
    left_out: amountAt(record, 'left_out'),
    columns,
    rows,
    cells: cellsAt(record, 'cells', columns * rows),
    pan_deg: numbersAt(record, 'pan_deg', 2),
    tilt_deg: numbersAt(record, 'tilt_deg', 2),
    text: textAt(record, 'text'),
    notes: textAt(record, 'notes')
      .split('\n')
      .filter((line) => line !== ''),
    coverage: amountAt(record, 'coverage'),
    triangles: amountAt(record, 'triangles'),
  };
}
