// SPDX-License-Identifier: Apache-2.0
import {
  FieldError,
  amountAt,
  choiceAt,
  countersAt,
  flagAt,
  numberAt,
  numbersAt,
  recordOf,
  recordsAt,
  textAt,
  type JsonRecord,
} from './json_fields';
import { scanProgressOf, type ScanProgress } from './scan_progress';

export const kServerStates = ['live', 'learning', 'no_agent', 'stalled', 'no_depth'] as const;
export type ServerState = (typeof kServerStates)[number];

/** What happened to an object of the scene. */
export interface Contact {
  age_s: number;
  /** touch, rest or problem. */
  event: string;
  object: string;
  /** What it touched. */
  with: string;
  impulse_ns: number;
  /** Of a problem: a sentence. */
  text: string;
}

export interface StageTime {
  name: string;
  budget_ms: number;
  wall_ms: number;
  cpu_ms: number;
}

export interface AgentHealth {
  epoch: string;
  name: string;
  age_s: number;
  color_fps: number;
  depth_fps: number;
  drops: number;
  queue: number;
  encode_ms: number;
  lost: number;
  /** Pictures that parity made whole; null: not known. */
  repaired: number | null;
  /** Share of datagrams that did not arrive in the last 10 s, 0..1. */
  slice_loss: number | null;
  /** Median time on the way beyond the fastest, last 10 s. */
  delay_ms: number | null;
  recording: boolean | null;
}

/** What the agents write to their disks. */
export interface Recording {
  active: boolean;
  seconds: number;
  dropped: number;
}

/** SPEC 4.2 `stats`, twice a second. */
export interface Stats {
  server_us: number;
  state: ServerState;
  /** The sentence a person reads; empty when live. */
  message: string;
  fps: number;
  frames: number;
  width: number;
  height: number;
  /** Capture to encoded over the last 10 s. */
  latency_ms: { p50: number; p99: number };
  bitrate_bps: number;
  viewers: number;
  /** Since the server's start, by reason. */
  drops: ReadonlyMap<string, number>;
  stages: StageTime[];
  agents: AgentHealth[];
  depth_age_s: number;
  /** Added to the times of depth pictures by what the show tells; null: not known yet. */
  depth_clock_ms: number | null;
  /** Null: not known. */
  recording: Recording | null;
  /** Where the last picture's colour camera stands, rows of a 3 x 4 matrix; null: not known. */
  T_scene_color: number[] | null;
  /** Of the last 10 s, the newest first; null: nothing happened. */
  contacts: Contact[] | null;
  /** A live scan of the room; null: none has been heard of for a minute. */
  scan: ScanProgress | null;
}

function contactOf(record: JsonRecord): Contact {
  return {
    age_s: amountAt(record, 'age_s'),
    event: textAt(record, 'event'),
    object: textAt(record, 'object'),
    with: textAt(record, 'with'),
    impulse_ns: amountAt(record, 'impulse_ns'),
    text: textAt(record, 'text'),
  };
}

/** What an older server leaves out is not known. */
function ifThere<T>(record: JsonRecord, key: string, read: (from: JsonRecord, key: string) => T): T | null {
  return record[key] === undefined ? null : read(record, key);
}

function shareAt(record: JsonRecord, key: string): number {
  const share = amountAt(record, key);
  if (share > 1) throw new FieldError(`${key} is above 1`);
  return share;
}

function recordingAt(record: JsonRecord, key: string): Recording {
  const recording = recordOf(record[key], key);
  return {
    active: flagAt(recording, 'active'),
    seconds: amountAt(recording, 'seconds'),
    dropped: amountAt(recording, 'dropped'),
  };
}

function stageOf(record: JsonRecord): StageTime {
  return {
    name: textAt(record, 'name'),
    budget_ms: amountAt(record, 'budget_ms'),
    wall_ms: amountAt(record, 'wall_ms'),
    cpu_ms: amountAt(record, 'cpu_ms'),
  };
}

function agentOf(record: JsonRecord): AgentHealth {
  return {
    epoch: textAt(record, 'epoch'),
    name: textAt(record, 'name'),
    age_s: amountAt(record, 'age_s'),
    color_fps: amountAt(record, 'color_fps'),
    depth_fps: amountAt(record, 'depth_fps'),
    drops: amountAt(record, 'drops'),
    queue: amountAt(record, 'queue'),
    encode_ms: amountAt(record, 'encode_ms'),
    lost: amountAt(record, 'lost'),
    repaired: ifThere(record, 'repaired', amountAt),
    slice_loss: ifThere(record, 'slice_loss', shareAt),
    delay_ms: ifThere(record, 'delay_ms', amountAt),
    recording: ifThere(record, 'recording', flagAt),
  };
}

/** Throws `FieldError` naming the field. */
export function statsOf(record: JsonRecord): Stats {
  const latency = recordOf(record['latency_ms'], 'latency_ms');
  return {
    server_us: numberAt(record, 'server_us'),
    state: choiceAt(record, 'state', kServerStates),
    message: textAt(record, 'message'),
    fps: amountAt(record, 'fps'),
    frames: amountAt(record, 'frames'),
    width: amountAt(record, 'width'),
    height: amountAt(record, 'height'),
    latency_ms: { p50: numberAt(latency, 'p50'), p99: numberAt(latency, 'p99') },
    bitrate_bps: amountAt(record, 'bitrate_bps'),
    viewers: amountAt(record, 'viewers'),
    drops: countersAt(record, 'drops'),
    stages: recordsAt(record, 'stages').map(stageOf),
    agents: recordsAt(record, 'agents').map(agentOf),
    depth_age_s: numberAt(record, 'depth_age_s'),
    depth_clock_ms: ifThere(record, 'depth_clock_ms', numberAt),
    recording: ifThere(record, 'recording', recordingAt),
    T_scene_color: ifThere(record, 'T_scene_color', (from, key) => numbersAt(from, key, 12)),
    contacts: ifThere(record, 'contacts', (from, key) => recordsAt(from, key).map(contactOf)),
    scan: ifThere(record, 'scan', (from, key) => scanProgressOf(recordOf(from[key], key))),
  };
}
