// SPDX-License-Identifier: Apache-2.0
import { existsSync, readFileSync } from 'node:fs';
import { describe, expect, it } from 'vitest';
import { decodeControlMessage } from './control_message';

const kStats = {
  type: 'stats',
  server_us: 5,
  state: 'live',
  message: '',
  fps: 30,
  frames: 9,
  width: 1024,
  height: 768,
  latency_ms: { p50: 40, p99: 60 },
  bitrate_bps: 4e6,
  viewers: 1,
  drops: { lost: 2, late: 3 },
  stages: [{ name: 'warp_depth', budget_ms: 3, wall_ms: 2.5, cpu_ms: 4 }],
  agents: [
    {
      epoch: '0123456789abcdef',
      name: 'head-1',
      age_s: 0.2,
      color_fps: 30,
      depth_fps: 12.5,
      drops: 0,
      queue: 0,
      encode_ms: 2,
      lost: 0,
      repaired: 4,
      slice_loss: 0.01,
      delay_ms: 1.2,
      recording: false,
    },
  ],
  depth_age_s: 0.04,
  depth_clock_ms: -24.9,
  recording: { active: false, seconds: 0, dropped: 0 },
  contacts: [{ age_s: 0.4, event: 'touch', object: 'vase', with: 'floor', impulse_ns: 1.9, text: '' }],
  T_scene_color: [0, 0, 1, 2, -1, 0, 0, 0.5, 0, -1, 0, 1.4],
};
const kHello = {
  type: 'hello',
  protocol: 1,
  name: 'studio-1',
  server_us: 7,
  role: 'director',
  streams: [{ stream: 'color', codec: 'avc1.64001F', width: 1024, height: 768 }],
  camera: { width: 1024, height: 768, fx: 900, fy: 901, cx: 511.5, cy: 383.5 },
};
const kObject = {
  id: 1,
  name: 'statue',
  file: 'statue.glb',
  pose: [1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
  body: 'mutual',
  triangles: 1200,
  bounds: [-1, -1, 0, 1, 1, 2],
  base: [2, 0, 0],
  radius_m: 0.3,
  hidden: false,
};
const kLight = { id: 1, name: 'lamp', kind: 'area', position: [0, 0, 2], color: [1, 1, 1], intensity: 1 };
const kScene = {
  type: 'scene',
  revision: 7,
  frame: 'world',
  up: [0, 0, 1],
  can_undo: true,
  can_redo: false,
  unsaved: true,
  by: 'anna',
  edits: 3,
  objects: [kObject],
  lights: [kLight],
  models: ['statue.glb'],
};

// The C++ tests read the same file. What viewers send is the server's to judge.
const kFile = new URL('../../../../tests/vectors/scene_message.json', import.meta.url);
const kVectors = existsSync(kFile)
  ? (
      JSON.parse(readFileSync(kFile, 'utf8')) as {
        name: string;
        from: string;
        message: unknown;
        ok: boolean;
      }[]
    ).filter(({ from }) => from === 'server')
  : [];

function reasonOf(message: unknown): string {
  const decoded = decodeControlMessage(typeof message === 'string' ? message : JSON.stringify(message));
  return decoded.ok ? 'accepted' : decoded.reason;
}

describe('a control message', () => {
  it('reads stats whole', () => {
    const decoded = decodeControlMessage(JSON.stringify(kStats));
    if (!decoded.ok || decoded.value.type !== 'stats') throw new Error(reasonOf(kStats));
    const { drops, ...rest } = decoded.value.stats;
    expect([...drops]).toEqual([
      ['lost', 2],
      ['late', 3],
    ]);
    const { type: _type, drops: _drops, ...sent } = kStats;
    expect(rest).toEqual({ ...sent, scan: null });
  });

  it('reads hello and leaves out streams of a later version', () => {
    const later = { stream: 'normals', codec: 'av01', width: 'wide' };
    const decoded = decodeControlMessage(JSON.stringify({ ...kHello, streams: [...kHello.streams, later] }));
    if (!decoded.ok || decoded.value.type !== 'hello') throw new Error(reasonOf(kHello));
    expect(decoded.value.hello.streams).toEqual(kHello.streams);
  });

  it('reads nothing but the number of a protocol that it does not speak', () => {
    const decoded = decodeControlMessage('{"type":"hello","protocol":2}');
    expect(decoded).toEqual({
      ok: true,
      value: {
        type: 'hello',
        hello: { protocol: 2, name: '', server_us: 0, streams: [], role: 'viewer', camera: null },
      },
    });
  });

  it('passes over types of a later version', () => {
    expect(decodeControlMessage('{"type":"later"}')).toEqual({
      ok: true,
      value: { type: 'unknown', name: 'later' },
    });
  });

  it('names the field that it refuses', () => {
    expect(reasonOf('{')).toBe('message: not JSON');
    expect(reasonOf('[]')).toBe('message: message is not an object');
    expect(reasonOf({})).toBe('message: type is not text');
    expect(reasonOf({ ...kStats, state: 'asleep' })).toMatch(/^stats: state is none of live, /);
    expect(reasonOf({ ...kStats, fps: -1 })).toBe('stats: fps is negative');
    expect(reasonOf({ ...kStats, fps: null })).toBe('stats: fps is not a finite number');
    expect(reasonOf({ ...kStats, drops: { lost: 'two' } })).toBe('stats: lost is not a finite number');
    expect(reasonOf({ ...kStats, agents: Array(257).fill(kStats.agents[0]) })).toBe(
      'stats: agents is not a list of at most 256',
    );
    expect(reasonOf({ ...kStats, stages: [7] })).toBe('stats: stages[0] is not an object');
    expect(reasonOf({ ...kHello, streams: [{ ...kHello.streams[0], width: 0 }] })).toBe(
      'hello: width is not 1..8192',
    );
    expect(reasonOf({ type: 'pong', viewer_us: 1 })).toBe('pong: server_us is not a finite number');
  });

  it('refuses what lacks any one field', () => {
    const optional = ['type', 'recording', 'depth_clock_ms', 'contacts', 'T_scene_color'];
    for (const key of Object.keys(kStats).filter((name) => !optional.includes(name))) {
      const { [key as keyof typeof kStats]: _left, ...rest } = kStats;
      expect(reasonOf(rest), key).not.toBe('accepted');
    }
    for (const key of Object.keys(kScene).filter((name) => name !== 'type')) {
      const { [key as keyof typeof kScene]: _left, ...rest } = kScene;
      expect(reasonOf(rest), key).not.toBe('accepted');
    }
  });

  it('takes what an older server leaves out as not known', () => {
    const { recording: _recording, T_scene_color: _pose, ...rest } = kStats;
    const { repaired: _r, slice_loss: _s, delay_ms: _d, recording: _a, ...agent } = kStats.agents[0] ?? {};
    const decoded = decodeControlMessage(JSON.stringify({ ...rest, agents: [agent] }));
    if (!decoded.ok || decoded.value.type !== 'stats') throw new Error('refused');
    expect(decoded.value.stats.recording).toBeNull();
    expect(decoded.value.stats.T_scene_color).toBeNull();
    expect(decoded.value.stats.agents[0]).toMatchObject({
      slice_loss: null,
      delay_ms: null,
      recording: null,
    });
    const { role: _role, camera: _camera, ...hello } = kHello;
    const greeted = decodeControlMessage(JSON.stringify(hello));
    if (!greeted.ok || greeted.value.type !== 'hello') throw new Error('refused');
    expect(greeted.value.hello).toMatchObject({ role: 'viewer', camera: null });
  });

  it('reads a scene whole', () => {
    const decoded = decodeControlMessage(JSON.stringify(kScene));
    if (!decoded.ok || decoded.value.type !== 'scene') throw new Error(reasonOf(kScene));
    const { type: _type, ...sent } = kScene;
    expect(decoded.value.scene).toEqual(sent);
  });

  it('names what is wrong in a scene', () => {
    const withObject = (part: object): unknown => ({ ...kScene, objects: [{ ...kObject, ...part }] });
    expect(reasonOf(withObject({ pose: [1, 2, 3] }))).toBe('scene: pose is not 16 finite numbers');
    expect(reasonOf(withObject({ base: [1, null, 3] }))).toBe('scene: base is not 3 finite numbers');
    expect(reasonOf(withObject({ id: 0 }))).toBe('scene: id is not a whole number from 1');
    expect(reasonOf(withObject({ hidden: 1 }))).toBe('scene: hidden is neither true nor false');
    expect(reasonOf({ ...kScene, up: [0, 0, 2] })).toBe('scene: up is not of length 1');
    expect(reasonOf({ ...kScene, frame: 'moon' })).toBe('scene: frame is none of world, camera');
    expect(reasonOf({ ...kScene, models: [7] })).toBe('scene: models[0] is not text');
    expect(reasonOf({ ...kScene, lights: [{ ...kLight, intensity: -1 }] })).toBe(
      'scene: intensity is negative',
    );
  });

  it.each(kVectors)('$name', ({ message, ok }) => {
    expect(decodeControlMessage(JSON.stringify(message)).ok).toBe(ok);
  });

  it('reads why an edit was not done', () => {
    expect(decodeControlMessage('{"type":"refused","id":3,"reason":"There is no object 9."}')).toEqual({
      ok: true,
      value: { type: 'refused', refused: { id: 3, reason: 'There is no object 9.' } },
    });
    expect(reasonOf({ ...kHello, role: 'king' })).toBe('hello: role is none of viewer, director');
    expect(reasonOf({ ...kHello, camera: { ...kHello.camera, fx: 0 } })).toBe(
      'hello: camera has a focal length of 0',
    );
  });

  it('cuts text that no person would read', () => {
    const decoded = decodeControlMessage(JSON.stringify({ ...kStats, message: 'x'.repeat(100_000) }));
    if (!decoded.ok || decoded.value.type !== 'stats') throw new Error('refused');
    expect(decoded.value.stats.message.length).toBe(512);
  });
});
