// SPDX-License-Identifier: Apache-2.0
import type { Role } from '../transport/control_message';
import type { Stats } from '../transport/stats';
import type { Status } from '../view/messages';
import { el, setData, setText } from './dom';
import { icon } from './icons';
import { count, fixed, kNoNumber } from './numbers';
import type { State } from './state_sentence';

interface Metric {
  root: HTMLElement;
  value: HTMLElement;
}

function metric(testid: string, unit: string, title: string): Metric {
  const value = el('span', { class: 'metric-value', text: kNoNumber, testid });
  return {
    root: el(
      'span',
      { class: 'metric', attributes: { title } },
      value,
      el('span', { class: 'metric-unit', text: unit }),
    ),
    value,
  };
}

export function totalDrops(stats: Stats): number {
  return [...stats.drops.values()].reduce((sum, drops) => sum + drops, 0);
}

/** The one line that is always there: who, in what state, and the four numbers that matter. */
export class TopBar {
  readonly root: HTMLElement;
  readonly details_button: HTMLButtonElement;
  readonly help_button: HTMLButtonElement;
  readonly logout_button: HTMLButtonElement;
  readonly #user = el('span', { class: 'user-name', testid: 'user' });
  readonly #state = el('span', { class: 'state', testid: 'state' });
  readonly #word = el('span', { class: 'state-word', testid: 'state-word' });
  readonly #show = el('span', { class: 'show', testid: 'show-name' });
  readonly #fps = metric('fps', 'fps', 'Pictures shown a second');
  readonly #latency = metric('latency', 'ms', 'Capture to display, median of the last second');
  readonly #rate = metric('bitrate', 'Mb/s', 'Received by this page');
  readonly #drops = metric('drops', 'drops', 'Pictures dropped since the server started');

  constructor() {
    this.#state.append(el('span', { class: 'state-dot' }), this.#word);
    this.details_button = el(
      'button',
      {
        class: 'metrics',
        testid: 'details-button',
        attributes: {
          type: 'button',
          'aria-expanded': 'false',
          'aria-controls': 'details',
          title: 'Times, drops and agents (I)',
        },
      },
      this.#fps.root,
      this.#latency.root,
      this.#rate.root,
      this.#drops.root,
      el('span', { class: 'metrics-open' }, icon('details'), el('span', { text: 'Details' })),
    );
    this.help_button = el(
      'button',
      { class: 'bar-button', testid: 'help-button', attributes: { type: 'button', title: 'Keys (?)' } },
      icon('help'),
      el('span', { text: 'Keys' }),
    );
    this.logout_button = el(
      'button',
      { class: 'bar-button', testid: 'logout', attributes: { type: 'button' } },
      icon('user'),
      this.#user,
      el('span', { class: 'quiet', text: 'Log out' }),
    );
    this.logout_button.hidden = true;
    this.root = el(
      'header',
      { class: 'bar' },
      el('span', { class: 'brand' }, icon('brand'), el('span', { text: 'MixStage' })),
      this.#state,
      this.#show,
      el('span', { class: 'bar-space' }),
      this.details_button,
      this.help_button,
      this.logout_button,
    );
  }

  /** Empty without login. */
  setUser(name: string, role: Role): void {
    this.logout_button.hidden = name === '';
    setText(this.#user, role === 'viewer' && name !== '' ? `${name} (viewer)` : name);
    this.logout_button.setAttribute('aria-label', `Log ${name} out`);
  }

  setState(state: State): void {
    setText(this.#word, state.word);
    setData(this.#state, 'tone', state.tone);
  }

  setShow(name: string): void {
    setText(this.#show, name);
    this.#show.title = name;
  }

  /** Numbers of a picture that stands still would be a lie: without a fresh one they are not shown. */
  setNumbers(status: Status, stats: Stats | null, picture_is_fresh: boolean): void {
    const shown = picture_is_fresh && status.wanted.includes('color');
    setText(this.#fps.value, fixed(shown ? status.fps : null, 1));
    setText(this.#latency.value, fixed(shown ? status.latency_ms : null, 0));
    setText(this.#rate.value, fixed(status.megabits_per_s, 1));
    setText(this.#drops.value, stats === null ? fixed(null, 0) : count(totalDrops(stats)));
  }
}
