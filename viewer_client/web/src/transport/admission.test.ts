// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { admit, type Fetch } from './admission';

const kUrl = 'wss://studio/show/watch';
const kToken = 'a'.repeat(43);
const kTicket = { ticket: 't', role: 'viewer', name: 'anna' };

/** Answers every request and keeps what was asked. */
function server(status: number, body: unknown): { asked: [string, RequestInit][]; answer: Fetch } {
  const asked: [string, RequestInit][] = [];
  const json = async (): Promise<unknown> => {
    if (body instanceof Error) throw body;
    return body;
  };
  const answer: Fetch = async (url, init) => {
    asked.push([url, init]);
    return { ok: status < 300, status, json };
  };
  return { asked, answer };
}

describe('admission', () => {
  it('asks whether a login is needed before it has a token', async () => {
    const { asked, answer } = server(200, { status: 'ok', login: true });
    expect(await admit(kUrl, null, answer)).toEqual({ kind: 'login' });
    expect(asked[0]?.[0]).toBe('https://studio/show/healthz');
  });

  it('walks in where nobody logs in', async () => {
    expect(await admit(kUrl, null, server(200, { status: 'ok' }).answer)).toEqual({ kind: 'open' });
    expect(await admit(kUrl, kToken, server(405, '').answer)).toEqual({ kind: 'open' });
  });

  it('changes a token for a ticket, the token in a header and nowhere else', async () => {
    const { asked, answer } = server(200, kTicket);
    expect(await admit(kUrl, kToken, answer)).toEqual({ kind: 'ticket', ticket: 't', name: 'anna' });
    const [url, init] = asked[0] ?? ['', {}];
    expect(url).toBe('https://studio/show/login');
    expect(init.headers).toEqual({ Authorization: `Bearer ${kToken}` });
  });

  it('says that a token is wrong, without asking when it is none', async () => {
    const { asked, answer } = server(401, '');
    expect(await admit(kUrl, kToken, answer)).toEqual({ kind: 'wrong_token' });
    expect(await admit(kUrl, 'not a token\n', answer)).toEqual({ kind: 'wrong_token' });
    expect(asked.length).toBe(1);
  });

  it.each([
    [429, {}],
    [500, {}],
    [200, new SyntaxError('no JSON')],
    [200, []],
    [200, { ticket: 7, name: 'anna' }],
  ])('waits after %i with %j', async (status, body) => {
    expect(await admit(kUrl, kToken, server(status, body).answer)).toEqual({ kind: 'later' });
  });

  it('waits for a network that is away', async () => {
    const away: Fetch = () => Promise.reject(new TypeError('Failed to fetch'));
    expect(await admit(kUrl, null, away)).toEqual({ kind: 'later' });
  });
});
