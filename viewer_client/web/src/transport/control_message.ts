// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';
import { FieldError, numberAt, recordOf, recordsAt, textAt, type JsonRecord } from './json_fields';
import { kStreamNames, type StreamName } from './picture_message';
import { statsOf, type Stats } from './stats';

/** The version of the viewer stream that this page speaks. */
export const kProtocol = 1;
const kMaxPictureSide = 8192;

export interface StreamOffer {
  stream: StreamName;
  /** WebCodecs codec string, such as avc1.64001F. */
  codec: string;
  width: number;
  height: number;
}

export interface Hello {
  protocol: number;
  /** Name of the show. */
  name: string;
  server_us: number;
  /** Empty until the server has seen a first picture. */
  streams: StreamOffer[];
}

export interface Pong {
  viewer_us: number;
  server_us: number;
}

export type ControlMessage =
  | { type: 'hello'; hello: Hello }
  | { type: 'stats'; stats: Stats }
  | { type: 'pong'; pong: Pong }
  /** Of a later version: skipped, not refused. */
  | { type: 'unknown'; name: string };

export type ViewerMessage =
  { type: 'ping'; viewer_us: number } | { type: 'subscribe'; streams: StreamName[] } | { type: 'keyframe' };

function sideAt(record: JsonRecord, key: string): number {
  const side = numberAt(record, key);
  if (!Number.isInteger(side) || side < 1 || side > kMaxPictureSide)
    throw new FieldError(`${key} is not 1..${kMaxPictureSide}`);
  return side;
}

function offersAt(record: JsonRecord): StreamOffer[] {
  return recordsAt(record, 'streams').flatMap((item) => {
    const stream = kStreamNames.find((known) => known === item['stream']);
    if (stream === undefined) return []; // a stream of a later version
    return [
      { stream, codec: textAt(item, 'codec'), width: sideAt(item, 'width'), height: sideAt(item, 'height') },
    ];
  });
}

function helloOf(record: JsonRecord): Hello {
  const protocol = numberAt(record, 'protocol');
  const known = protocol === kProtocol;
  return {
    protocol,
    name: known ? textAt(record, 'name') : '',
    server_us: known ? numberAt(record, 'server_us') : 0,
    streams: known ? offersAt(record) : [],
  };
}

/** Reads one text message; the reason of a refusal names the field. */
export function decodeControlMessage(text: string): Decoded<ControlMessage> {
  let type = 'message';
  try {
    const record = recordOf(JSON.parse(text), 'message');
    type = textAt(record, 'type');
    if (type === 'hello') return accept({ type, hello: helloOf(record) });
    if (type === 'stats') return accept({ type, stats: statsOf(record) });
    if (type === 'pong') {
      return accept({
        type,
        pong: { viewer_us: numberAt(record, 'viewer_us'), server_us: numberAt(record, 'server_us') },
      });
    }
    return accept({ type: 'unknown', name: type });
  } catch (error) {
    if (error instanceof FieldError) return refuse(`${type}: ${error.message}`);
    if (error instanceof SyntaxError) return refuse(`${type}: not JSON`);
    throw error;
  }
}
