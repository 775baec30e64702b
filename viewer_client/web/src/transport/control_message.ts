// SPDX-License-Identifier: Apache-2.0
import { accept, refuse, type Decoded } from './decoded';
import type { Edit } from './edit';
import {
  FieldError,
  amountAt,
  choiceAt,
  numberAt,
  recordOf,
  recordsAt,
  textAt,
  type JsonRecord,
} from './json_fields';
import { kStreamNames, type StreamName } from './picture_message';
import { sceneOf, type Scene } from './scene';
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

export const kRoles = ['viewer', 'director'] as const;
export type Role = (typeof kRoles)[number];

/** The colour camera without its distortion, in pixels. */
export interface Pinhole {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
}

export interface Hello {
  protocol: number;
  /** Name of the show. */
  name: string;
  server_us: number;
  /** Empty until the server has seen a first picture. */
  streams: StreamOffer[];
  /** Of this viewer. A server that says nothing lets nobody edit. */
  role: Role;
  /** Null while not known. */
  camera: Pinhole | null;
}

/** An edit that was not done, and why: a sentence. */
export interface Refused {
  id: number;
  reason: string;
}

export interface Pong {
  viewer_us: number;
  server_us: number;
}

export type ControlMessage =
  | { type: 'hello'; hello: Hello }
  | { type: 'stats'; stats: Stats }
  | { type: 'pong'; pong: Pong }
  | { type: 'scene'; scene: Scene }
  | { type: 'refused'; refused: Refused }
  /** Of a later version: skipped, not refused. */
  | { type: 'unknown'; name: string };

/** What can be subscribed to: the streams of pictures, all meshes together, and light maps. */
export type Subscription = StreamName | 'mesh' | 'light';

export type ViewerMessage =
  | { type: 'ticket'; ticket: string }
  | { type: 'ping'; viewer_us: number }
  | { type: 'subscribe'; streams: Subscription[] }
  | { type: 'keyframe' }
  | Edit;

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

function cameraOf(record: JsonRecord): Pinhole | null {
  if (record['camera'] === undefined) return null;
  const camera = recordOf(record['camera'], 'camera');
  const pinhole = {
    width: sideAt(camera, 'width'),
    height: sideAt(camera, 'height'),
    fx: amountAt(camera, 'fx'),
    fy: amountAt(camera, 'fy'),
    cx: numberAt(camera, 'cx'),
    cy: numberAt(camera, 'cy'),
  };
  if (pinhole.fx === 0 || pinhole.fy === 0) throw new FieldError('camera has a focal length of 0');
  return pinhole;
}

function helloOf(record: JsonRecord): Hello {
  const protocol = numberAt(record, 'protocol');
  const known = protocol === kProtocol;
  return {
    protocol,
    name: known ? textAt(record, 'name') : '',
    server_us: known ? numberAt(record, 'server_us') : 0,
    streams: known ? offersAt(record) : [],
    role: known && record['role'] !== undefined ? choiceAt(record, 'role', kRoles) : 'viewer',
    camera: known ? cameraOf(record) : null,
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
    if (type === 'scene') return accept({ type, scene: sceneOf(record) });
    if (type === 'refused')
      return accept({ type, refused: { id: numberAt(record, 'id'), reason: textAt(record, 'reason') } });
    return accept({ type: 'unknown', name: type });
  } catch (error) {
    if (error instanceof FieldError) return refuse(`${type}: ${error.message}`);
    if (error instanceof SyntaxError) return refuse(`${type}: not JSON`);
    throw error;
  }
}
