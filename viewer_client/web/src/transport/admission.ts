// SPDX-License-Identifier: Apache-2.0
import { FieldError, recordOf, textAt } from './json_fields';

/** What stands between this page and /watch (SPEC 4.4). */
export type Admission =
  /** Nobody has to log in here. */
  | { kind: 'open' }
  /** Serves once, within 30 s. */
  | { kind: 'ticket'; ticket: string; name: string }
  /** A person has to give a token. */
  | { kind: 'login' }
  | { kind: 'wrong_token' }
  /** Nothing answered, or too many tried: later. */
  | { kind: 'later' };

const kToken = /^[\w-]{43}$/;
const kPatience_ms = 4000;

/** The part of fetch that is used, so that tests can stand in for it. */
export type Fetch = (url: string, init: RequestInit) => Promise<Pick<Response, 'ok' | 'status' | 'json'>>;

async function logIn(url: string, token: string, fetch_: Fetch): Promise<Admission> {
  // What is no token is not sent: a header takes no other characters anyway.
  if (!kToken.test(token)) return { kind: 'wrong_token' };
  const headers = { Authorization: `Bearer ${token}` };
  const signal = AbortSignal.timeout(kPatience_ms);
  const reply = await fetch_(url, { method: 'POST', headers, cache: 'no-store', signal });
  if (reply.status === 401) return { kind: 'wrong_token' };
  if (reply.status === 404 || reply.status === 405) return { kind: 'open' };
  if (!reply.ok) return { kind: 'later' };
  const record = recordOf(await reply.json(), 'login');
  return { kind: 'ticket', ticket: textAt(record, 'ticket'), name: textAt(record, 'name') };
}

async function ask(url: string, fetch_: Fetch): Promise<Admission> {
  const reply = await fetch_(url, { cache: 'no-store', signal: AbortSignal.timeout(kPatience_ms) });
  if (!reply.ok) return { kind: 'later' };
  return { kind: recordOf(await reply.json(), 'health')['login'] === true ? 'login' : 'open' };
}

/** One attempt to be let in. `watch_url` is /watch's; login and health lie beside it. */
export async function admit(
  watch_url: string,
  token: string | null,
  fetch_: Fetch = (url, init) => fetch(url, init),
): Promise<Admission> {
  const beside = (name: string): string => {
    const url = new URL(name, watch_url);
    url.protocol = url.protocol === 'wss:' ? 'https:' : 'http:';
    return url.href;
  };
  try {
    return token === null
      ? await ask(beside('healthz'), fetch_)
      : await logIn(beside('login'), token, fetch_);
  } catch (error) {
    // A network that failed, a reply that is no JSON, a field that is missing: the same to whoever waits.
    const expected = error instanceof FieldError || error instanceof SyntaxError;
    if (!expected && !(error instanceof TypeError) && !(error instanceof DOMException)) throw error;
    return { kind: 'later' };
  }
}
