// SPDX-License-Identifier: Apache-2.0
import { existsSync, readFileSync } from 'node:fs';
import { describe, expect, it } from 'vitest';
import { decodeMeshMessage, isMeshMessage } from './mesh_message';

interface Fields {
  stream: number;
  frame: string;
  capture_us: string;
  encoded_us: string;
  id: number;
  T_scene_color: number[];
  mesh_hex: string;
  texture_hex: string;
}
type Vector = { name: string; hex: string } & ({ ok: true; fields: Fields } | { ok: false; reason: string });

const kStreams = ['actor', 'room', 'object'];
// The C++ tests read the same file.
const kFile = new URL('../../../../tests/vectors/watch_mesh.json', import.meta.url);
const kVectors = existsSync(kFile) ? (JSON.parse(readFileSync(kFile, 'utf8')) as Vector[]) : [];
const kIdentity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

/** A message of the parts in the middle of a larger buffer. */
function message({ stream = 3, id = 0, mesh = 'drc', texture = '', pose = kIdentity } = {}): DataView {
  const payload_bytes = 60 + mesh.length + texture.length;
  const view = new DataView(new ArrayBuffer(48 + payload_bytes + 9), 3, 48 + payload_bytes);
  const bytes = new Uint8Array(view.buffer, 3, view.byteLength);
  bytes.set(new TextEncoder().encode('MXW1'));
  view.setUint8(4, stream);
  view.setUint16(6, 48, true);
  view.setBigUint64(8, 7n, true);
  view.setUint32(32, payload_bytes, true);
  view.setUint32(48, id, true);
  view.setUint32(52, mesh.length, true);
  view.setUint32(56, texture.length, true);
  pose.forEach((number, index) => view.setFloat32(60 + 4 * index, number, true));
  bytes.set(new TextEncoder().encode(mesh + texture), 108);
  return view;
}

function reasonOf(view: DataView): string {
  const decoded = decodeMeshMessage(view);
  return decoded.ok ? 'accepted' : decoded.reason;
}

describe('a mesh message', () => {
  it('gives mesh and texture as views into the message', () => {
    const view = message({ stream: 5, id: 9, mesh: 'drc', texture: 'jpeg' });
    const decoded = decodeMeshMessage(view);
    if (!decoded.ok) throw new Error(decoded.reason);
    const { mesh, texture, ...rest } = decoded.value;
    expect(rest).toMatchObject({ stream: 'object', id: 9, frame: 7n, T_scene_color: kIdentity });
    expect(new TextDecoder().decode(mesh)).toBe('drc');
    expect(new TextDecoder().decode(texture)).toBe('jpeg');
    expect(mesh.buffer).toBe(view.buffer);
  });

  it('is known by its stream', () => {
    expect([1, 2, 3, 4, 5, 6].map((stream) => isMeshMessage(message({ stream })))).toEqual([
      false,
      false,
      true,
      true,
      true,
      false,
    ]);
    expect(isMeshMessage(new DataView(new ArrayBuffer(4)))).toBe(false);
  });

  it('says that the actor is out of view with an empty mesh; nobody else may', () => {
    expect(reasonOf(message({ mesh: '' }))).toBe('accepted');
    expect(reasonOf(message({ mesh: '', texture: 'jpeg' }))).toBe('parts');
    expect(reasonOf(message({ stream: 4, mesh: '' }))).toBe('parts');
    expect(reasonOf(message({ stream: 5, id: 1, mesh: '' }))).toBe('parts');
  });

  it('is refused with its reason', () => {
    expect(reasonOf(message({ stream: 1 }))).toBe('stream');
    expect(reasonOf(message({ stream: 5, id: 0 }))).toBe('id');
    expect(reasonOf(message({ id: 4 }))).toBe('id');
    expect(reasonOf(message({ pose: [...kIdentity.slice(0, 11), NaN] }))).toBe('pose');
    const wrapping = message();
    wrapping.setUint32(52, 0xffff_ffff, true);
    wrapping.setUint32(56, 4, true);
    expect(reasonOf(wrapping)).toBe('parts');
  });

  it('cut anywhere is refused', () => {
    const whole = message({ texture: 'jpeg' });
    for (let bytes = 0; bytes < whole.byteLength; ++bytes)
      expect(decodeMeshMessage(new DataView(whole.buffer, 3, bytes)).ok, `${bytes} bytes`).toBe(false);
  });

  it('of any bytes never throws', () => {
    const whole = message({ texture: 'jpeg' });
    let state = 1;
    for (let round = 0; round < 5000; ++round) {
      const bytes = new Uint8Array(whole.buffer.slice(3, 3 + whole.byteLength));
      for (let hit = 0; hit < 3; ++hit) {
        state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
        bytes[state % bytes.length] = state >>> 24;
      }
      expect(() => decodeMeshMessage(new DataView(bytes.buffer))).not.toThrow();
    }
  });

  it.runIf(kVectors.length > 0)('is covered by vectors for every reason of refusal', () => {
    const reasons = new Set(kVectors.flatMap((vector) => (vector.ok ? [] : [vector.reason])));
    expect([...reasons].sort()).toEqual([
      'header',
      'id',
      'length',
      'magic',
      'parts',
      'pose',
      'short',
      'stream',
    ]);
  });

  it.each(kVectors)('$name', (vector) => {
    const bytes = Buffer.from(vector.hex, 'hex');
    const buffer = new ArrayBuffer(bytes.length + 11);
    new Uint8Array(buffer).fill(0xa5).set(bytes, 3);
    const decoded = decodeMeshMessage(new DataView(buffer, 3, bytes.length));
    if (!vector.ok) {
      expect(decoded).toEqual({ ok: false, reason: vector.reason });
      return;
    }
    if (!decoded.ok) throw new Error(decoded.reason);
    const { mesh, texture, ...rest } = decoded.value;
    const { fields } = vector;
    expect(rest).toEqual({
      stream: kStreams[fields.stream - 3],
      frame: BigInt(fields.frame),
      capture_us: BigInt(fields.capture_us),
      encoded_us: BigInt(fields.encoded_us),
      id: fields.id,
      T_scene_color: fields.T_scene_color,
    });
    expect(Buffer.from(mesh).toString('hex')).toBe(fields.mesh_hex);
    expect(Buffer.from(texture).toString('hex')).toBe(fields.texture_hex);
  });
});
