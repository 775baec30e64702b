// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';
import { decodeHeader, type HeaderRefusal } from './message_header';

const kLightStream = 6;

/** SPEC 4.1, stream 6: by how much virtual objects dim what the camera sees, as a picture. */
export interface LightMessage {
  frame: bigint;
  /** A view into the message. */
  jpeg: Uint8Array<ArrayBuffer>;
}

/** The reasons a message is refused, in the order they are checked. */
export type LightRefusal = HeaderRefusal | 'stream';

/** Whether a binary message is a light map, by its stream alone: says which reader is to judge it. */
export function isLightMessage(view: DataView): boolean {
  return view.byteLength > 4 && view.getUint8(4) === kLightStream;
}

/** Reads one binary message of stream 6. Nothing is copied. */
export function decodeLightMessage(view: DataView): Decoded<LightMessage> {
  const no = (reason: LightRefusal): Decoded<LightMessage> => refuse(reason);
  const header = decodeHeader(view);
  if (!header.ok) return header;
  const { stream, frame, payload } = header.value;
  if (stream !== kLightStream) return no('stream');
  return accept({ frame, jpeg: payload });
}
