// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { decodeLightMessage, isLightMessage } from './light_message';

/** A message in the middle of a larger buffer. */
function message(stream: number, payload: number[]): DataView {
  const view = new DataView(new ArrayBuffer(48 + payload.length + 9), 3, 48 + payload.length);
  const bytes = new Uint8Array(view.buffer, 3, view.byteLength);
  bytes.set(new TextEncoder().encode('MXW1'));
  view.setUint8(4, stream);
  view.setUint16(6, 48, true);
  view.setBigUint64(8, 7n, true);
  view.setUint32(32, payload.length, true);
  bytes.set(payload, 48);
  return view;
}

describe('a light map message', () => {
  it('is told by its stream', () => {
    expect(isLightMessage(message(6, [1]))).toBe(true);
    expect(isLightMessage(message(5, [1]))).toBe(false);
    expect(isLightMessage(new DataView(new ArrayBuffer(4)))).toBe(false);
  });
  it('gives its picture', () => {
    const decoded = decodeLightMessage(message(6, [0xff, 0xd8, 0xff]));
    if (!decoded.ok) throw new Error(decoded.reason);
    expect(decoded.value.frame).toBe(7n);
    expect([...decoded.value.jpeg]).toEqual([0xff, 0xd8, 0xff]);
  });
  it('is refused where it is none', () => {
    expect(decodeLightMessage(message(2, [1]))).toEqual({ ok: false, reason: 'stream' });
    expect(decodeLightMessage(message(6, []))).toEqual({ ok: false, reason: 'length' });
    expect(decodeLightMessage(new DataView(message(6, [1]).buffer, 3, 20))).toEqual({ ok: false, reason: 'short' });
  });
});
