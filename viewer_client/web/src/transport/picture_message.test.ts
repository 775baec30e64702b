// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from 'node:fs';
import { describe, expect, it } from 'vitest';
import { decodePictureMessage, kStreamNames } from './picture_message';

interface Fields {
  stream: number;
  key: boolean;
  frame: string;
  capture_us: string;
  encoded_us: string;
  near_m: number;
  far_m: number;
  payload_hex: string;
}
type Vector = { name: string; hex: string } & ({ ok: true; fields: Fields } | { ok: false; reason: string });

// The C++ tests read the same file.
const kVectors = JSON.parse(
  readFileSync(new URL('../../../../tests/vectors/watch.json', import.meta.url), 'utf8'),
) as Vector[];

/** The message in the middle of a larger buffer: what is read must not depend on where it lies. */
function viewOf(hex: string): DataView {
  const bytes = Buffer.from(hex, 'hex');
  const buffer = new ArrayBuffer(bytes.length + 11);
  new Uint8Array(buffer).fill(0xa5).set(bytes, 3);
  return new DataView(buffer, 3, bytes.length);
}

describe('a picture message', () => {
  it('is covered by vectors for every reason of refusal', () => {
    const reasons = new Set(kVectors.flatMap((vector) => (vector.ok ? [] : [vector.reason])));
    expect([...reasons].sort()).toEqual(['header', 'length', 'magic', 'range', 'short', 'stream']);
  });

  it.each(kVectors)('$name', (vector) => {
    const decoded = decodePictureMessage(viewOf(vector.hex));
    if (!vector.ok) {
      expect(decoded).toEqual({ ok: false, reason: vector.reason });
      return;
    }
    if (!decoded.ok) throw new Error(decoded.reason);
    const { payload, ...header } = decoded.value;
    const { fields } = vector;
    expect(header).toEqual({
      stream: kStreamNames[fields.stream - 1],
      key: fields.key,
      frame: BigInt(fields.frame),
      capture_us: BigInt(fields.capture_us),
      encoded_us: BigInt(fields.encoded_us),
      near_m: fields.near_m,
      far_m: fields.far_m,
    });
    expect(Buffer.from(payload).toString('hex')).toBe(fields.payload_hex);
  });

  it('cut anywhere is refused', () => {
    const whole = kVectors.find((vector) => vector.ok)?.hex ?? '';
    for (let bytes = 0; bytes < whole.length / 2; ++bytes) {
      expect(decodePictureMessage(viewOf(whole.slice(0, 2 * bytes))).ok, `${bytes} bytes`).toBe(false);
    }
  });
});
