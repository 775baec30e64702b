// SPDX-License-Identifier: Apache-2.0
import type { Stats } from '../transport/stats';
import type { Link } from '../transport/watch_socket';
import { kProtocol } from '../transport/control_message';
import { span } from './numbers';

export type Tone = 'live' | 'busy' | 'warning' | 'alarm';

export interface Picture {
  /** null: none was drawn yet. */
  age_s: number | null;
}

export interface Situation {
  /** null: fine; else what this browser lacks. */
  unsupported: { sentence: string; advice: string } | null;
  link: Link;
  /** The page has spoken with the server before. */
  was_open: boolean;
  protocol: number | null;
  stats: Stats | null;
  picture: Picture;
  undecodable: string | null;
}

export interface State {
  /** One or two words for the top bar, upper case. */
  word: string;
  tone: Tone;
  /** What is so; empty when there is nothing to say. */
  sentence: string;
  /** What to do about it. */
  advice: string;
}

/** A picture older than this is not live. */
export const kStaleAfter_s = 1;

function state(word: string, tone: Tone, sentence: string, advice = ''): State {
  return { word, tone, sentence, advice };
}

function ofLink({ link, was_open }: Situation): State {
  // The form on the picture says the rest.
  if (link.phase === 'login' || link.phase === 'wrong_token') return state('LOG IN', 'busy', '');
  if (link.attempt === 0 && !was_open) return state('CONNECTING', 'busy', 'Connecting to the server...');
  return state(
    'RECONNECTING',
    'alarm',
    `Reconnecting (${Math.max(1, link.attempt)})`,
    'The server does not answer. If this lasts, start mixstage-server on its machine.',
  );
}

function ofServer(stats: Stats, picture: Picture): State {
  const says = (fallback: string): string => (stats.message === '' ? fallback : stats.message);
  switch (stats.state) {
    case 'no_agent':
      return state(
        'NO AGENT',
        'alarm',
        says("No agent is publishing. Start mixstage-agent on the rig's machine."),
      );
    case 'stalled':
      return state(
        'STALLED',
        'alarm',
        says('The agent lives, but no colour picture comes. Check the colour camera and its cable.'),
      );
    case 'learning':
      return state('LEARNING', 'busy', says('Learning the empty set. Keep everybody out of the picture.'));
    case 'no_depth':
      return state(
        'NO DEPTH',
        'warning',
        says(`Depth stopped ${span(stats.depth_age_s)} ago: the key holds the last matte.`),
      );
    case 'live': {
      const shown = ofPicture(picture);
      return stats.message === '' || shown.tone !== 'live' ? shown : state('LIVE', 'warning', stats.message);
    }
  }
}

function ofPicture(picture: Picture): State {
  if (picture.age_s === null) return state('WAITING', 'busy', 'Waiting for the first picture...');
  if (picture.age_s <= kStaleAfter_s) return state('LIVE', 'live', '');
  return state(
    'NO PICTURE',
    'alarm',
    `No new picture for ${span(picture.age_s)}.`,
    'The server says it is live: check the network between it and this browser.',
  );
}

/** What the page says about itself, the worst first. */
export function stateOf(situation: Situation): State {
  const { unsupported, protocol, stats, undecodable } = situation;
  if (unsupported !== null) return state('UNSUPPORTED', 'alarm', unsupported.sentence, unsupported.advice);
  if (situation.link.phase !== 'open') return ofLink(situation);
  if (protocol !== null && protocol !== kProtocol) {
    return state(
      'OTHER VERSION',
      'alarm',
      `The server speaks protocol ${protocol}, this page ${kProtocol}.`,
      'Reload the page to get the one that fits.',
    );
  }
  if (undecodable !== null) {
    return state(
      'UNSUPPORTED',
      'alarm',
      `This browser cannot decode the colour stream (${undecodable}).`,
      'Open the page in Chromium, Chrome or Edge.',
    );
  }
  if (stats === null) return ofPicture(situation.picture);
  return ofServer(stats, situation.picture);
}
