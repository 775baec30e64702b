// SPDX-License-Identifier: Apache-2.0
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
    },
  ],
  depth_age_s: 0.04,
};
const kHello = {
  type: 'hello',
  protocol: 1,
  name: 'studio-1',
  server_us: 7,
  streams: [{ stream: 'color', codec: 'avc1.64001F', width: 1024, height: 768 }],
};

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
    expect(rest).toEqual(sent);
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
      value: { type: 'hello', hello: { protocol: 2, name: '', server_us: 0, streams: [] } },
    });
  });

  it('passes over types of a later version', () => {
    expect(decodeControlMessage('{"type":"mesh"}')).toEqual({
      ok: true,
      value: { type: 'unknown', name: 'mesh' },
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
    for (const key of Object.keys(kStats).filter((name) => name !== 'type')) {
      const { [key as keyof typeof kStats]: _left, ...rest } = kStats;
      expect(reasonOf(rest), key).not.toBe('accepted');
    }
  });

  it('cuts text that no person would read', () => {
    const decoded = decodeControlMessage(JSON.stringify({ ...kStats, message: 'x'.repeat(100_000) }));
    if (!decoded.ok || decoded.value.type !== 'stats') throw new Error('refused');
    expect(decoded.value.stats.message.length).toBe(512);
  });
});
