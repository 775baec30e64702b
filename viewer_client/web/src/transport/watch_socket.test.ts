// SPDX-License-Identifier: Apache-2.0
import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { WatchSocket, type Link, type SocketLike } from './watch_socket';

class FakeSocket implements SocketLike {
  binaryType: BinaryType = 'blob';
  readyState = 1;
  onclose: ((event: CloseEvent) => void) | null = null;
  onmessage: ((event: MessageEvent) => void) | null = null;
  sent: string[] = [];
  send(data: string): void {
    this.sent.push(data);
  }
  close(): void {
    this.readyState = 3;
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
let watch: WatchSocket;

function newest(): FakeSocket {
  const socket = sockets.at(-1);
  if (socket === undefined) throw new Error('nothing was opened');
  return socket;
}

beforeEach(() => {
  vi.useFakeTimers();
  sockets = [];
  links = [];
  refused = [];
  const handlers = {
    onLink: (link: Link) => links.push(link),
    onPicture: () => undefined,
    onControl: () => undefined,
    onRefused: (reason: string) => refused.push(reason),
  };
  watch = new WatchSocket('ws://here/watch', handlers, () => {
    sockets.push(new FakeSocket());
    return newest();
  });
});
afterEach(() => {
  watch.close();
  vi.useRealTimers();
});

describe('WatchSocket', () => {
  it('comes back after 0.5, 1, 2, 4 and 4 s and counts', () => {
    for (const [index, wait_ms] of [500, 1000, 2000, 4000, 4000].entries()) {
      newest().breaks();
      expect(links.at(-1)).toEqual({ phase: 'waiting', attempt: index + 1 });
      vi.advanceTimersByTime(wait_ms - 1);
      expect(sockets.length).toBe(index + 1);
      vi.advanceTimersByTime(1);
      expect(sockets.length).toBe(index + 2);
    }
  });

  it('counts from the start again once a hello came, not when a socket opened', () => {
    newest().breaks();
    vi.advanceTimersByTime(500);
    newest().breaks();
    vi.advanceTimersByTime(1000);
    newest().says(kHello);
    expect(links.at(-1)).toEqual({ phase: 'open', attempt: 0 });
    newest().breaks();
    expect(links.at(-1)).toEqual({ phase: 'waiting', attempt: 1 });
  });

  it('gives up a peer that has fallen silent', () => {
    newest().says(kHello);
    vi.advanceTimersByTime(3900);
    newest().says('{"type":"later"}');
    vi.advanceTimersByTime(3900);
    expect(links.at(-1)?.phase).toBe('open');
    vi.advanceTimersByTime(300);
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
    newest().says('{"type":"pong"}');
    expect(refused).toEqual(['picture: short', 'pong: viewer_us is not a finite number']);
    newest().says(kHello);
    expect(links.at(-1)?.phase).toBe('open');
  });

  it('sends nothing while there is no connection', () => {
    expect(watch.send({ type: 'keyframe' })).toBe(true);
    newest().breaks();
    expect(watch.send({ type: 'keyframe' })).toBe(false);
  });

  it('stays closed once closed', () => {
    watch.close();
    vi.advanceTimersByTime(60_000);
    expect(sockets.length).toBe(1);
  });
});
