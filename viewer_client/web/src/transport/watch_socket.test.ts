// SPDX-License-Identifier: Apache-2.0
import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import type { Admission } from './admission';
import { WatchSocket, type Link, type SocketLike } from './watch_socket';

class FakeSocket implements SocketLike {
  binaryType: BinaryType = 'blob';
  readyState = 1;
  onopen: ((event: Event) => void) | null = null;
  onclose: ((event: CloseEvent) => void) | null = null;
  onmessage: ((event: MessageEvent) => void) | null = null;
  sent: string[] = [];
  send(data: string): void {
    this.sent.push(data);
  }
  close(): void {
    this.readyState = 3;
  }
  opens(): void {
    this.onopen?.({} as Event);
  }
  says(data: unknown): void {
    this.onmessage?.({ data } as MessageEvent);
  }
  breaks(): void {
    this.readyState = 3;
    this.onclose?.({} as CloseEvent);
  }
}

const kHello = '{"type":"hello","protocol":1,"name":"a","server_us":0,"streams":[]}';
let sockets: FakeSocket[];
let links: Link[];
let refused: string[];
let tokens: (string | null)[];
let admission: Admission;
let watch: WatchSocket;

function newest(): FakeSocket {
  const socket = sockets.at(-1);
  if (socket === undefined) throw new Error('nothing was opened');
  return socket;
}

beforeEach(async () => {
  vi.useFakeTimers();
  tokens = [];
  admission = { kind: 'open' };
  sockets = [];
  links = [];
  refused = [];
  const handlers = {
    onLink: (link: Link) => links.push(link),
    onPicture: () => undefined,
    onMesh: () => undefined,
    onLight: () => undefined,
    onControl: () => undefined,
    onRefused: (reason: string) => refused.push(reason),
  };
  watch = new WatchSocket('ws://here/watch', null, handlers, {
    admit: async (_, token) => {
      tokens.push(token);
      return admission;
    },
    makeSocket: () => {
      sockets.push(new FakeSocket());
      return newest();
    },
  });
  await vi.advanceTimersByTimeAsync(0);
});
afterEach(() => {
  watch.close();
  vi.useRealTimers();
});

describe('WatchSocket', () => {
  it('comes back after 0.5, 1, 2, 4 and 4 s and counts', async () => {
    for (const [index, wait_ms] of [500, 1000, 2000, 4000, 4000].entries()) {
      newest().breaks();
      expect(links.at(-1)).toEqual({ phase: 'waiting', attempt: index + 1 });
      await vi.advanceTimersByTimeAsync(wait_ms - 1);
      expect(sockets.length).toBe(index + 1);
      await vi.advanceTimersByTimeAsync(1);
      expect(sockets.length).toBe(index + 2);
    }
  });

  it('counts from the start again once a hello came, not when a socket opened', async () => {
    newest().breaks();
    await vi.advanceTimersByTimeAsync(500);
    newest().breaks();
    await vi.advanceTimersByTimeAsync(1000);
    newest().says(kHello);
    expect(links.at(-1)).toEqual({ phase: 'open', attempt: 0 });
    newest().breaks();
    expect(links.at(-1)).toEqual({ phase: 'waiting', attempt: 1 });
  });

  it('gives up a peer that has fallen silent', async () => {
    newest().says(kHello);
    await vi.advanceTimersByTimeAsync(3900);
    newest().says('{"type":"later"}');
    await vi.advanceTimersByTimeAsync(3900);
    expect(links.at(-1)?.phase).toBe('open');
    await vi.advanceTimersByTimeAsync(300);
    expect(links.at(-1)?.phase).toBe('waiting');
    expect(sockets[0]?.readyState).toBe(3);
  });

  it('does not listen to a socket that it has left', () => {
    const first = newest();
    first.breaks();
    first.says(kHello);
    expect(links.at(-1)?.phase).toBe('waiting');
  });

  it('reports what it does not believe and goes on', () => {
    newest().says(new ArrayBuffer(3));
    newest().says(new Uint8Array([0x4d, 0x58, 0x57, 0x31, 3]).buffer);
    newest().says('{"type":"pong"}');
    expect(refused).toEqual(['picture: short', 'mesh: short', 'pong: viewer_us is not a finite number']);
    newest().says(kHello);
    expect(links.at(-1)?.phase).toBe('open');
  });

  it('sends nothing while there is no connection', () => {
    expect(watch.send({ type: 'keyframe' })).toBe(true);
    newest().breaks();
    expect(watch.send({ type: 'keyframe' })).toBe(false);
  });

  it('stays closed once closed', async () => {
    watch.close();
    await vi.advanceTimersByTimeAsync(60_000);
    expect(sockets.length).toBe(1);
  });

  it('waits for a token, and sends the ticket that it brings before anything else', async () => {
    admission = { kind: 'login' };
    newest().breaks();
    await vi.advanceTimersByTimeAsync(60_000);
    expect(links.at(-1)?.phase).toBe('login');
    expect(sockets.length).toBe(1);
    admission = { kind: 'wrong_token' };
    watch.logIn('wrong');
    await vi.advanceTimersByTimeAsync(60_000);
    expect(links.at(-1)?.phase).toBe('wrong_token');
    admission = { kind: 'ticket', ticket: 'abc', name: 'anna' };
    watch.logIn('right');
    await vi.advanceTimersByTimeAsync(0);
    newest().opens();
    expect(newest().sent).toEqual(['{"type":"ticket","ticket":"abc"}']);
    expect(watch.name).toBe('anna');
    expect(tokens).toEqual([null, null, 'wrong', 'right']);
  });

  it('tries again later when nothing answers, and fetches a ticket for each connection', async () => {
    admission = { kind: 'later' };
    watch.logIn('right');
    await vi.advanceTimersByTimeAsync(0);
    expect(links.at(-1)).toEqual({ phase: 'waiting', attempt: 1 });
    admission = { kind: 'ticket', ticket: 'abc', name: 'anna' };
    await vi.advanceTimersByTimeAsync(500);
    newest().breaks();
    await vi.advanceTimersByTimeAsync(1000);
    expect(tokens).toEqual([null, 'right', 'right', 'right']);
  });

  it('forgets the connection of the one who logged out', async () => {
    newest().says(kHello);
    const first = newest();
    admission = { kind: 'login' };
    watch.logIn(null);
    await vi.advanceTimersByTimeAsync(0);
    expect(first.readyState).toBe(3);
    expect(links.at(-1)?.phase).toBe('login');
  });
});
