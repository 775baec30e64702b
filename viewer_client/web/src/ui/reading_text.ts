// SPDX-License-Identifier: Apache-2.0
import type { ProbeReading } from '../view/depth_probe';
import { metres } from './numbers';

/** What stands in a pane's head and beside the probe. */
export function readingText(reading: ProbeReading | null): string {
  return reading === null ? '' : metres(reading.z_m);
}

/** All that is known about the pixel, for the tooltip. */
export function readingDetail(reading: ProbeReading | null): string {
  if (reading === null) return '';
  const { x, y, median_m, label, coverage } = reading;
  return `pixel ${x}, ${y}; 3x3 median ${metres(median_m)}; ${label}, alpha ${coverage.toFixed(2)}`;
}
