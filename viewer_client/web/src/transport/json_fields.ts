// SPDX-License-Identifier: Apache-2.0

// Fields of JSON that came over the wire. A missing or wrong field throws `FieldError`, which never leaves
// `decodeControlMessage`; so a reader of twenty fields reads like the table in SPEC 4.2.
export type JsonRecord = Readonly<Record<string, unknown>>;

export class FieldError extends Error {}

const kMaxTextChars = 512;
const kMaxListItems = 256;

export function recordOf(value: unknown, what: string): JsonRecord {
  if (typeof value !== 'object' || value === null || Array.isArray(value))
    throw new FieldError(`${what} is not an object`);
  return value as JsonRecord;
}

export function numberAt(record: JsonRecord, key: string): number {
  const value = record[key];
  if (typeof value !== 'number' || !Number.isFinite(value))
    throw new FieldError(`${key} is not a finite number`);
  return value;
}

/** A number that cannot be negative. */
export function amountAt(record: JsonRecord, key: string): number {
  const value = numberAt(record, key);
  if (value < 0) throw new FieldError(`${key} is negative`);
  return value;
}

/** Text, cut at 512 characters: it is shown to a person and never believed further. */
export function textAt(record: JsonRecord, key: string): string {
  const value = record[key];
  if (typeof value !== 'string') throw new FieldError(`${key} is not text`);
  return value.slice(0, kMaxTextChars);
}

export function recordsAt(record: JsonRecord, key: string): JsonRecord[] {
  const value = record[key];
  if (!Array.isArray(value) || value.length > kMaxListItems)
    throw new FieldError(`${key} is not a list of at most ${kMaxListItems}`);
  return value.map((item, index) => recordOf(item, `${key}[${index}]`));
}

export function textsAt(record: JsonRecord, key: string): string[] {
  const value = record[key];
  if (!Array.isArray(value) || value.length > kMaxListItems)
    throw new FieldError(`${key} is not a list of at most ${kMaxListItems}`);
  return value.map((item, index) => {
    if (typeof item !== 'string') throw new FieldError(`${key}[${index}] is not text`);
    return item.slice(0, kMaxTextChars);
  });
}

/** One of the names that are known. */
export function choiceAt<T extends string>(record: JsonRecord, key: string, choices: readonly T[]): T {
  const choice = choices.find((known) => known === record[key]);
  if (choice === undefined) throw new FieldError(`${key} is none of ${choices.join(', ')}`);
  return choice;
}

export function flagAt(record: JsonRecord, key: string): boolean {
  const value = record[key];
  if (typeof value !== 'boolean') throw new FieldError(`${key} is neither true nor false`);
  return value;
}

/** A number that the server gave to a thing of the scene, from 1. */
export function idAt(record: JsonRecord, key: string): number {
  const value = numberAt(record, key);
  if (!Number.isInteger(value) || value < 1 || value > 0xffff_ffff)
    throw new FieldError(`${key} is not a whole number from 1`);
  return value;
}

/** Exactly `count` finite numbers. */
export function numbersAt(record: JsonRecord, key: string, count: number): number[] {
  const value = record[key];
  if (!Array.isArray(value) || value.length !== count || !value.every(Number.isFinite))
    throw new FieldError(`${key} is not ${count} finite numbers`);
  return value as number[];
}

/** Counters by name. */
export function countersAt(record: JsonRecord, key: string): ReadonlyMap<string, number> {
  const counters = recordOf(record[key], key);
  const names = Object.keys(counters);
  if (names.length > kMaxListItems) throw new FieldError(`${key} has more than ${kMaxListItems} entries`);
  return new Map(names.map((name) => [name.slice(0, kMaxTextChars), amountAt(counters, name)]));
}
