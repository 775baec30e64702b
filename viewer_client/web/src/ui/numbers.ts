// SPDX-License-Identifier: Apache-2.0

/** What stands where a number is not known. */
export const kNoNumber = '–';

export function fixed(value: number | null, digits: number): string {
  return value === null || !Number.isFinite(value) ? kNoNumber : value.toFixed(digits);
}

export function metres(z_m: number | null): string {
  return z_m === null ? 'no depth' : `${z_m.toFixed(2)} m`;
}

/** A time span as a person says it: 3 s, 2 min, 4 h. */
export function span(seconds: number): string {
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min`;
  return `${Math.floor(seconds / 3600)} h`;
}

const kThousands = new Intl.NumberFormat('en-US', { maximumFractionDigits: 0 });

export function count(value: number): string {
  return kThousands.format(value);
}
