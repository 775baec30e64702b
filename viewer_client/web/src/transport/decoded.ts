// SPDX-License-Identifier: Apache-2.0

/** What came of reading bytes from the world: a value, or a reason that a person can act on. */
export type Decoded<T> = { ok: true; value: T } | { ok: false; reason: string };

export function accept<T>(value: T): Decoded<T> {
  return { ok: true, value };
}

export function refuse<T>(reason: string): Decoded<T> {
  return { ok: false, reason };
}
