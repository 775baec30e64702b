// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';
import { decodeHeader, type HeaderRefusal } from './message_header';

// SPEC 4.3: what stands in the payload before the mesh.
const kPrefixBytes = 60;
const kPoseOffset = 12;
const kPoseNumbers = 12;
const kFirstStream = 3;

export type MeshStream = 'actor' | 'room' | 'object';
const kMeshStreams: readonly MeshStream[] = ['actor', 'room', 'object'];

/** One mesh, whole in itself. */
export interface MeshMessage {
  stream: MeshStream;
  frame: bigint;
  capture_us: bigint;
  encoded_us: bigint;
  /** Of the object, from 1; 0 for actor and room. */
  id: number;
  /** Rows of the 3 x 4 pose of the colour camera when the picture was taken (actor), else identity. */
  T_scene_color: number[];
  /** Draco bitstream, a view into the message; empty when no actor is in view. */
  mesh: Uint8Array;
  /** JPEG, a view into the message; empty: none. */
  texture: Uint8Array;
}

/** The reasons a message is refused, in the order they are checked. */
export type MeshRefusal = HeaderRefusal | 'stream' | 'parts' | 'id' | 'pose';

/** Whether a binary message is a mesh's, by its stream alone: says which reader is to judge it. */
export function isMeshMessage(view: DataView): boolean {
  return view.byteLength > 4 && kMeshStreams[view.getUint8(4) - kFirstStream] !== undefined;
}

/** Reads one binary message of streams 3 to 5. Nothing is copied. */
export function decodeMeshMessage(view: DataView): Decoded<MeshMessage> {
  const no = (reason: MeshRefusal): Decoded<MeshMessage> => refuse(reason);
  const header = decodeHeader(view);
  if (!header.ok) return header;
  const { payload, frame, capture_us, encoded_us } = header.value;
  const stream = kMeshStreams[header.value.stream - kFirstStream];
  if (stream === undefined) return no('stream');
  if (payload.byteLength < kPrefixBytes) return no('parts');
  const prefix = new DataView(payload.buffer, payload.byteOffset, kPrefixBytes);
  const mesh_bytes = prefix.getUint32(4, true);
  const texture_bytes = prefix.getUint32(8, true);
  if (kPrefixBytes + mesh_bytes + texture_bytes !== payload.byteLength) return no('parts');
  // Only an actor may be out of view, and nothing cannot be textured.
  if (mesh_bytes === 0 && (stream !== 'actor' || texture_bytes > 0)) return no('parts');
  const id = prefix.getUint32(0, true);
  if ((stream === 'object') !== id > 0) return no('id');
  const T_scene_color = Array.from({ length: kPoseNumbers }, (_, index) =>
    prefix.getFloat32(kPoseOffset + 4 * index, true),
  );
  if (!T_scene_color.every(Number.isFinite)) return no('pose');
  const mesh_end = kPrefixBytes + mesh_bytes;
  return accept({
    stream,
    frame,
    capture_us,
    encoded_us,
    id,
    T_scene_color,
    mesh: payload.subarray(kPrefixBytes, mesh_end),
    texture: payload.subarray(mesh_end),
  });
}
