// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { kServerStates, type ServerState, type Stats } from '../transport/stats';
import { stateOf, type Situation } from './state_sentence';

function stats(state: ServerState, message = ''): Stats {
  return {
    server_us: 0,
    state,
    message,
    fps: 30,
    frames: 1,
    width: 4,
    height: 3,
    latency_ms: { p50: 0, p99: 0 },
    bitrate_bps: 0,
    viewers: 1,
    drops: new Map(),
    stages: [],
    agents: [],
    recording: null,
    T_scene_color: null,
    contacts: null,
    scan: null,
    depth_age_s: 3.4,
    depth_clock_ms: null,
  };
}
const kLive: Situation = {
  unsupported: null,
  link: { phase: 'open', attempt: 0 },
  was_open: true,
  protocol: 1,
  stats: stats('live'),
  picture: { age_s: 0.03 },
  undecodable: null,
};
const situation = (changes: Partial<Situation>): Situation => ({ ...kLive, ...changes });

describe('the state', () => {
  it('is live only with a fresh picture, and then says nothing', () => {
    expect(stateOf(kLive)).toEqual({ word: 'LIVE', tone: 'live', sentence: '', advice: '' });
    expect(stateOf(situation({ stats: stats('live', 'The camera was nudged.') }))).toMatchObject({
      word: 'LIVE',
      tone: 'warning',
      sentence: 'The camera was nudged.',
    });
    expect(stateOf(situation({ picture: { age_s: 3.7 } }))).toMatchObject({
      word: 'NO PICTURE',
      sentence: 'No new picture for 3 s.',
    });
    expect(stateOf(situation({ picture: { age_s: null } })).sentence).toBe(
      'Waiting for the first picture...',
    );
  });

  it("says a sentence in every state but live, the server's own where it has one", () => {
    for (const state of kServerStates.filter((name) => name !== 'live')) {
      expect(stateOf(situation({ stats: stats(state) })).sentence, state).toMatch(/\.$/);
      expect(stateOf(situation({ stats: stats(state, 'Do this.') })).sentence).toBe('Do this.');
    }
    expect(stateOf(situation({ stats: stats('no_depth') })).sentence).toBe(
      'Depth stopped 3 s ago: the key holds the last matte.',
    );
    expect(stateOf(situation({ stats: stats('no_agent') })).sentence).toContain('Start mixstage-agent');
  });

  it('counts attempts to come back', () => {
    const first = situation({ link: { phase: 'connecting', attempt: 0 }, was_open: false, stats: null });
    expect(stateOf(first).sentence).toBe('Connecting to the server...');
    const again = situation({ link: { phase: 'waiting', attempt: 2 } });
    expect(stateOf(again)).toMatchObject({ word: 'RECONNECTING', sentence: 'Reconnecting (2)' });
  });

  it('names the worst first', () => {
    const unsupported = { sentence: 'No.', advice: 'Do.' };
    expect(stateOf(situation({ unsupported, link: { phase: 'waiting', attempt: 3 } })).sentence).toBe('No.');
    expect(stateOf(situation({ protocol: 2 })).sentence).toBe('The server speaks protocol 2, this page 1.');
    expect(stateOf(situation({ undecodable: 'avc1.FFFFFF' })).sentence).toContain('avc1.FFFFFF');
  });
});
