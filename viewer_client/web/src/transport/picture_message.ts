// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';
import { decodeHeader, type HeaderRefusal, type MessageHeader } from './message_header';

export type StreamName = 'color' | 'depth';
export const kStreamNames: readonly StreamName[] = ['color', 'depth'];

/** SPEC 4.1. `near_m`, `far_m`: depth of code 1023 and of code 1; of no meaning for colour. */
export interface PictureMessage extends Omit<MessageHeader, 'stream' | 'flags'> {
  stream: StreamName;
  /** Decoding can start here. */
  key: boolean;
}

/** The reasons a message is refused, in the order they are checked. */
export type PictureRefusal = HeaderRefusal | 'stream' | 'range';

/** Reads one binary message: its payload is one H.264 access unit, Annex B. Nothing is copied. */
export function decodePictureMessage(view: DataView): Decoded<PictureMessage> {
  const no = (reason: PictureRefusal): Decoded<PictureMessage> => refuse(reason);
  const header = decodeHeader(view);
  if (!header.ok) return header;
  const { stream: code, flags, ...rest } = header.value;
  const stream = kStreamNames[code - 1];
  if (stream === undefined) return no('stream');
  if (stream === 'depth') {
    const { near_m, far_m } = rest;
    const finite = Number.isFinite(near_m) && Number.isFinite(far_m);
    if (!finite || near_m <= 0 || near_m >= far_m) return no('range');
  }
  return accept({ ...rest, stream, key: (flags & 1) !== 0 });
}
