// SPDX-License-Identifier: Apache-2.0

/** In metres, as the camera sees it. */
export interface Step {
  right: number;
  away: number;
  up: number;
}

const kStep_m = 0.05;
const kFineStep_m = 0.01;
const kDirections: Readonly<Record<string, readonly [number, number, number]>> = {
  ArrowLeft: [-1, 0, 0],
  ArrowRight: [1, 0, 0],
  ArrowUp: [0, 1, 0],
  ArrowDown: [0, -1, 0],
  PageUp: [0, 0, 1],
  PageDown: [0, 0, -1],
};

/** What a key moves by, finer with Shift; null: nothing. */
export function stepOf(
  press: Pick<KeyboardEvent, 'key' | 'ctrlKey' | 'altKey' | 'metaKey' | 'shiftKey'>,
): Step | null {
  const direction = kDirections[press.key];
  if (direction === undefined || press.ctrlKey || press.altKey || press.metaKey) return null;
  const step_m = press.shiftKey ? kFineStep_m : kStep_m;
  const [right, away, up] = direction;
  return { right: right * step_m, away: away * step_m, up: up * step_m };
}
