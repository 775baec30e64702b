// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';

// SPEC 4.1, the header that all binary messages of the viewer stream begin with. All fields little-endian.
const kMagic = 0x3157584d; // "MXW1"
const kHeaderBytes = 48;
const kMaxPayloadBytes = 8_388_608;

export interface MessageHeader {
  /** Stream's number; not checked here. */
  stream: number;
  flags: number;
  /** Counts the camera's pictures since the server started; gaps are pictures that were never shown. */
  frame: bigint;
  /** Server clock, mid-exposure of the colour picture. */
  capture_us: bigint;
  /** Server clock, encoder done. */
  encoded_us: bigint;
  near_m: number;
  far_m: number;
  /** A view into the message, not a copy. */
  payload: Uint8Array<ArrayBuffer>;
}

/** The reasons that a header is refused for, in the order they are checked. */
export type HeaderRefusal = 'short' | 'magic' | 'header' | 'length';

export function decodeHeader(view: DataView): Decoded<MessageHeader> {
  const no = (reason: HeaderRefusal): Decoded<MessageHeader> => refuse(reason);
  if (view.byteLength < kHeaderBytes) return no('short');
  if (view.getUint32(0, true) !== kMagic) return no('magic');
  const header_bytes = view.getUint16(6, true);
  if (header_bytes < kHeaderBytes || header_bytes > view.byteLength) return no('header');
  const payload_bytes = view.getUint32(32, true);
  if (payload_bytes === 0 || payload_bytes > kMaxPayloadBytes) return no('length');
  if (header_bytes + payload_bytes !== view.byteLength) return no('length');
  return accept({
    stream: view.getUint8(4),
    flags: view.getUint8(5),
    frame: view.getBigUint64(8, true),
    capture_us: view.getBigInt64(16, true),
    encoded_us: view.getBigInt64(24, true),
    near_m: view.getFloat32(36, true),
    far_m: view.getFloat32(40, true),
    payload: new Uint8Array(view.buffer as ArrayBuffer, view.byteOffset + header_bytes, payload_bytes),
  });
}
