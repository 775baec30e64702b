// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import draco3d from 'draco3d';
import { describe, expect, it } from 'vitest';
import { DracoReader } from './draco_mesh';

const kWasm = readFileSync(createRequire(import.meta.url).resolve('draco3d/draco_decoder.wasm'));

function reader(): DracoReader {
  return new DracoReader(async () => new Uint8Array(kWasm).buffer);
}

/** Two triangles in a square of 2 m at z = 3, coloured and textured. */
async function square(): Promise<Uint8Array> {
  const draco = await draco3d.createEncoderModule({});
  const mesh = new draco.Mesh();
  const builder = new draco.MeshBuilder();
  builder.AddFacesToMesh(mesh, 2, new Uint32Array([0, 1, 2, 0, 2, 3]));
  builder.AddFloatAttribute(
    mesh,
    draco.POSITION,
    4,
    3,
    new Float32Array([-1, -1, 3, 1, -1, 3, 1, 1, 3, -1, 1, 3]),
  );
  builder.AddFloatAttribute(mesh, draco.TEX_COORD, 4, 2, new Float32Array([0, 0, 1, 0, 1, 1, 0, 1]));
  builder.AddUInt8Attribute(mesh, draco.COLOR, 4, 3, new Uint8Array([10, 20, 30, 1, 2, 3, 4, 5, 6, 7, 8, 9]));
  const encoder = new draco.Encoder();
  encoder.SetEncodingMethod(draco.MESH_EDGEBREAKER_ENCODING);
  encoder.SetAttributeQuantization(draco.POSITION, 12);
  encoder.SetAttributeQuantization(draco.TEX_COORD, 12);
  const out = new draco.DracoInt8Array();
  const bytes = encoder.EncodeMeshToDracoBuffer(mesh, out);
  return Uint8Array.from({ length: bytes }, (_, index) => out.GetValue(index) & 255);
}

describe('the Draco reader', () => {
  it('gives back what was encoded, to its quantisation', async () => {
    const decoded = await reader().decode(await square());
    if (!decoded.ok) throw new Error(decoded.reason);
    const { positions, uvs, normals, colors, indices } = decoded.value;
    expect(positions.length).toBe(12);
    expect(indices.length).toBe(6);
    expect(normals).toBeNull();
    // The encoder may order the points anew: each corner keeps its place, its texture and its colour together.
    const order = [0, 1, 2, 3].map((point) => {
      const [x, y, z] = [...positions.subarray(3 * point, 3 * point + 3)] as [number, number, number];
      expect(Math.abs(Math.abs(x) - 1)).toBeLessThan(1e-3);
      expect(z).toBeCloseTo(3, 3);
      expect(uvs?.[2 * point]).toBeCloseTo((x + 1) / 2, 3);
      expect(uvs?.[2 * point + 1]).toBeCloseTo((y + 1) / 2, 3);
      return colors?.[3 * point];
    });
    expect([...order].sort()).toEqual([1, 10, 4, 7]);
  });

  it('says what is no mesh', async () => {
    const draco = reader();
    for (const bytes of [
      new Uint8Array(0),
      new Uint8Array(10),
      new TextEncoder().encode('DRACO is not here'),
    ])
      expect((await draco.decode(bytes)).ok).toBe(false);
  });

  it('survives any bytes and goes on afterwards', async () => {
    const draco = reader();
    const whole = await square();
    let state = 7;
    for (let round = 0; round < 300; ++round) {
      const bytes = whole.slice(0, round % 3 === 0 ? (round * 7) % whole.length : whole.length);
      for (let hit = 0; hit < 2 && bytes.length > 0; ++hit) {
        state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
        bytes[state % bytes.length] = state >>> 24;
      }
      const decoded = await draco.decode(bytes);
      if (decoded.ok) expect(decoded.value.indices.length % 3).toBe(0);
    }
    expect((await draco.decode(whole)).ok).toBe(true);
  });
});
