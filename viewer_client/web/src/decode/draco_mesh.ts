// SPDX-License-Identifier: Apache-2.0
import type { Attribute, Decoder, DecoderModule, Mesh } from 'draco3d';
import createDraco from 'draco3d/draco_decoder_nodejs.js';
import { accept, refuse, type Decoded } from '../transport/decoded';

/** A triangle mesh in memory of its own. */
export interface MeshData {
  /** x, y, z a vertex, metres. */
  positions: Float32Array;
  /** u, v a vertex, v down. */
  uvs: Float32Array | null;
  normals: Float32Array | null;
  /** sRGB, three a vertex. */
  colors: Uint8Array | null;
  /** Three a triangle. */
  indices: Uint32Array;
}

// A room of ten times the detail would still fit; a lie about the size does not get memory.
const kMostPoints = 2_000_000;
const kMostFaces = 4_000_000;

interface Layout<T> {
  components: number;
  type: number;
  bytes_each: number;
  copy(address: number, count: number): T;
}

/** Draco bitstreams to triangles, in WebAssembly. Anything may be in the bytes. */
export class DracoReader {
  readonly #load: () => Promise<DecoderModule>;
  #draco: Promise<DecoderModule> | null = null;

  /** `wasm` gives the decoder's binary; asked again after a bitstream has broken it. */
  constructor(wasm: () => Promise<ArrayBuffer>) {
    this.#load = async () => createDraco({ wasmBinary: await wasm() });
  }

  async decode(bytes: Uint8Array): Promise<Decoded<MeshData>> {
    this.#draco ??= this.#load();
    try {
      return decodeWith(await this.#draco, bytes);
    } catch (error) {
      // Out of memory or a trap: what the module has become is not known, so the next mesh gets a new one.
      this.#draco = null;
      return refuse(`Draco: ${String(error)}`);
    }
  }
}

function decodeWith(draco: DecoderModule, bytes: Uint8Array): Decoded<MeshData> {
  const decoder = new draco.Decoder();
  const buffer = new draco.DecoderBuffer();
  const mesh = new draco.Mesh();
  try {
    buffer.Init(new Int8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength), bytes.byteLength);
    const status = decoder.DecodeBufferToMesh(buffer, mesh);
    if (!status.ok()) return refuse(`Draco: ${status.error_msg()}`);
    return read(draco, decoder, mesh);
  } finally {
    draco.destroy(mesh);
    draco.destroy(buffer);
    draco.destroy(decoder);
  }
}

function read(draco: DecoderModule, decoder: Decoder, mesh: Mesh): Decoded<MeshData> {
  const points = mesh.num_points();
  const faces = mesh.num_faces();
  if (points > kMostPoints || faces > kMostFaces)
    return refuse(`Draco: ${points} points and ${faces} faces are too many`);
  const floats = (components: number): Layout<Float32Array> => ({
    components,
    type: draco.DT_FLOAT32,
    bytes_each: 4,
    copy: (address, count) => new Float32Array(draco.HEAPF32.buffer, address, count).slice(),
  });
  const bytes: Layout<Uint8Array> = {
    components: 3,
    type: draco.DT_UINT8,
    bytes_each: 1,
    copy: (address, count) => new Uint8Array(draco.HEAPF32.buffer, address, count).slice(),
  };
  const attribute = <T>(kind: number, layout: Layout<T>): T | null => {
    const index = decoder.GetAttributeId(mesh, kind);
    if (index < 0) return null;
    return copyOf(draco, decoder, mesh, decoder.GetAttribute(mesh, index), layout);
  };
  const positions = attribute(draco.POSITION, floats(3));
  if (positions === null) return refuse('Draco: no positions');
  if (!positions.every(Number.isFinite)) return refuse('Draco: a position is not finite');
  const indices = inHeap(draco, 12 * faces, (address) => {
    decoder.GetTrianglesUInt32Array(mesh, 12 * faces, address);
    return new Uint32Array(draco.HEAPF32.buffer, address, 3 * faces).slice();
  });
  if (indices.some((index) => index >= points)) return refuse('Draco: a face names no point');
  return accept({
    positions,
    uvs: attribute(draco.TEX_COORD, floats(2)),
    normals: attribute(draco.NORMAL, floats(3)),
    colors: attribute(draco.COLOR, bytes),
    indices,
  });
}

/** Null where the attribute is of another shape than the wire promises. */
function copyOf<T>(
  draco: DecoderModule,
  decoder: Decoder,
  mesh: Mesh,
  attribute: Attribute,
  { components, type, bytes_each, copy }: Layout<T>,
): T | null {
  if (attribute.num_components() !== components) return null;
  const count = mesh.num_points() * components;
  return inHeap(draco, count * bytes_each, (address) => {
    // True when it was done; the types of the package know nothing of it.
    const done: unknown = decoder.GetAttributeDataArrayForAllPoints(
      mesh,
      attribute,
      type,
      count * bytes_each,
      address,
    );
    return done === true ? copy(address, count) : null;
  });
}

function inHeap<T>(draco: DecoderModule, bytes: number, use: (address: number) => T): T {
  const address = draco._malloc(Math.max(1, bytes));
  try {
    return use(address);
  } finally {
    draco._free(address);
  }
}
