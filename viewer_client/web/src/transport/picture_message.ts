// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';

// SPEC 4.1, the picture message of the viewer stream. All fields little-endian.
const kMagic = 0x3157584d; // "MXW1"
const kHeaderBytes = 48;
const kMaxPayloadBytes = 8_388_608;

export type StreamName = 'color' | 'depth';
export const kStreamNames: readonly StreamName[] = ['color', 'depth'];

export interface PictureMessage {
  stream: StreamName;
  /** Decoding can start here. */
  key: boolean;
  /** Counts the camera's pictures since the server started; gaps are pictures that were never shown. */
  frame: bigint;
  /** Server clock, mid-exposure of the colour picture. */
  capture_us: bigint;
  /** Server clock, encoder done. */
  encoded_us: bigint;
  /** Depth of code 1023 and of code 1; both 0 for colour. */
  near_m: number;
  far_m: number;
  /** One H.264 access unit, Annex B: a view into the message, not a copy. */
  payload: Uint8Array;
}

/** The reasons a message is refused, in the order they are checked. */
export type PictureRefusal = 'short' | 'magic' | 'header' | 'length' | 'stream' | 'range';

function streamName(code: number): StreamName | undefined {
  return kStreamNames[code - 1];
}

/** Reads one binary message. Refusals are a `PictureRefusal`; nothing is copied. */
export function decodePictureMessage(view: DataView): Decoded<PictureMessage> {
  const no = (reason: PictureRefusal): Decoded<PictureMessage> => refuse(reason);
  if (view.byteLength < kHeaderBytes) return no('short');
  if (view.getUint32(0, true) !== kMagic) return no('magic');
  const header_bytes = view.getUint16(6, true);
  if (header_bytes < kHeaderBytes || header_bytes > view.byteLength) return no('header');
  const payload_bytes = view.getUint32(32, true);
  if (payload_bytes === 0 || payload_bytes > kMaxPayloadBytes) return no('length');
  if (header_bytes + payload_bytes !== view.byteLength) return no('length');
  const stream = streamName(view.getUint8(4));
  if (stream === undefined) return no('stream');
  const near_m = view.getFloat32(36, true);
  const far_m = view.getFloat32(40, true);
  if (stream === 'depth') {
    const finite = Number.isFinite(near_m) && Number.isFinite(far_m);
    if (!finite || near_m <= 0 || near_m >= far_m) return no('range');
  }
  return accept({
    stream,
    key: (view.getUint8(5) & 1) !== 0,
    frame: view.getBigUint64(8, true),
    capture_us: view.getBigInt64(16, true),
    encoded_us: view.getBigInt64(24, true),
    near_m,
    far_m,
    payload: new Uint8Array(view.buffer as ArrayBuffer, view.byteOffset + header_bytes, payload_bytes),
  });
}
