// SPDX-License-Identifier: Apache-2.0
import type { AgentHealth, Stats } from '../transport/stats';
import type { Status } from '../view/messages';
import type { RoomCounts } from '../view/room_messages';
import { budgetBar, kFrameBudget_ms } from './budget_bar';
import { el } from './dom';
import { icon } from './icons';
import { count, fixed, span } from './numbers';
import { table, type Cell } from './table';

/** What the drop reasons of SPEC 4.2 mean; others are shown by their name alone. */
const kDropMeanings: Readonly<Record<string, string>> = {
  lost: 'never became whole in transport',
  late: 'skipped, a newer one was there',
};

function part(title: string, note: string, ...children: Node[]): HTMLElement {
  return el(
    'section',
    { class: 'details-part' },
    el(
      'h3',
      { class: 'details-title' },
      el('span', { text: title }),
      el('span', { class: 'details-note', text: note }),
    ),
    ...children,
  );
}

function stages(stats: Stats): HTMLElement {
  const bar = budgetBar(stats.stages);
  const segments = bar.segments.map((segment) => {
    const text = segment.width > 0.13 ? segment.name : '';
    const title = `${segment.name} ${segment.wall_ms.toFixed(1)} ms`;
    const box = el('span', { class: segment.over ? 'segment over' : 'segment', text, attributes: { title } });
    box.style.left = `${100 * segment.from}%`;
    box.style.width = `${100 * segment.width}%`;
    return box;
  });
  const line = el('span', { class: 'budget-line' });
  line.style.left = `${100 * bar.budget_at}%`;
  const rows = stats.stages.map((stage): Cell[] => {
    const over = stage.budget_ms > 0 && stage.wall_ms > stage.budget_ms;
    const wall = `${over ? '▲ ' : ''}${stage.wall_ms.toFixed(1)}`;
    return [
      { text: stage.name },
      over ? { text: wall, over, title: 'over its budget' } : { text: wall },
      { text: stage.cpu_ms.toFixed(1) },
      { text: stage.budget_ms.toFixed(1) },
    ];
  });
  return part(
    'Frame time',
    `${bar.total_ms.toFixed(1)} of ${kFrameBudget_ms} ms`,
    el(
      'div',
      {
        class: 'budget',
        testid: 'budget-bar',
        attributes: {
          role: 'img',
          'aria-label': `Stages take ${bar.total_ms.toFixed(1)} of ${kFrameBudget_ms} ms`,
        },
      },
      ...segments,
      line,
    ),
    table(
      [
        { title: 'stage' },
        { title: 'wall ms', number: true },
        { title: 'cpu ms', number: true },
        { title: 'budget ms', number: true },
      ],
      rows,
      'stage-table',
    ),
  );
}

function latency(stats: Stats, status: Status): HTMLElement {
  const trip = status.round_trip_ms;
  return part(
    'Latency',
    '',
    table(
      [{ title: 'from capture to' }, { title: 'median ms', number: true }, { title: 'p99 ms', number: true }],
      [
        [
          { text: 'encoded' },
          { text: fixed(stats.latency_ms.p50, 0) },
          { text: fixed(stats.latency_ms.p99, 0) },
        ],
        [
          { text: 'display here' },
          {
            text: fixed(status.latency_ms, 0),
            title: `clock known to ${fixed(trip === null ? null : trip / 2, 1)} ms`,
          },
          { text: '' },
        ],
      ],
      'latency-table',
    ),
  );
}

function drops(stats: Stats): HTMLElement {
  const rows = [...stats.drops].sort((a, b) => b[1] - a[1]);
  const total = rows.reduce((sum, row) => sum + row[1], 0);
  if (rows.length === 0) return part('Drops', 'none since the server started');
  return part(
    'Drops',
    `${count(total)} since the server started`,
    table(
      [{ title: 'reason' }, { title: '' }, { title: 'pictures', number: true }],
      rows.map(([reason, drops_of]) => [
        { text: reason },
        { text: kDropMeanings[reason] ?? '' },
        { text: count(drops_of) },
      ]),
      'drops-table',
    ),
  );
}

function contacts(stats: Stats): HTMLElement {
  const rows = stats.contacts ?? [];
  if (rows.length === 0) return part('Contacts', 'none in the last 10 s');
  return part(
    'Contacts',
    'last 10 s',
    table(
      [{ title: 'object' }, { title: 'what' }, { title: 'N s', number: true }, { title: 'ago', number: true }],
      rows.map((contact) => [
        { text: contact.object },
        { text: contact.event === 'problem' ? contact.text : `${contact.event} ${contact.with}` },
        { text: contact.event === 'touch' ? contact.impulse_ns.toFixed(2) : '' },
        { text: span(contact.age_s) },
      ]),
      'contacts-table',
    ),
  );
}

function agentRow(agent: AgentHealth): Cell[] {
  return [
    { text: agent.name, title: `epoch ${agent.epoch}` },
    { text: span(agent.age_s), title: 'since its last message' },
    { text: agent.color_fps.toFixed(1) },
    { text: agent.depth_fps.toFixed(1) },
    { text: agent.encode_ms.toFixed(1) },
    { text: count(agent.queue) },
    { text: count(agent.drops) },
  ];
}

function known(value: number | null, show: (value: number) => string): Cell {
  return value === null ? { text: fixed(null, 0), title: 'not known' } : { text: show(value) };
}

/** How pictures fare on the way from the rig. */
function wayRow(agent: AgentHealth): Cell[] {
  return [
    { text: agent.name },
    known(agent.slice_loss, (loss) => (100 * loss).toFixed(2)),
    known(agent.repaired, count),
    { text: count(agent.lost), over: agent.lost > 0 },
    known(agent.delay_ms, (delay) => delay.toFixed(1)),
    { text: agent.recording === null ? fixed(null, 0) : agent.recording ? 'yes' : 'no' },
  ];
}

function way(stats: Stats): HTMLElement {
  const number = true;
  const recording = stats.recording?.active === true ? stats.recording : null;
  return part(
    'Network and recording',
    recording === null
      ? 'last 10 s'
      : `recording for ${span(recording.seconds)}, ${count(recording.dropped)} dropped`,
    table(
      [
        { title: 'name' },
        { title: 'loss %', number },
        { title: 'repaired', number },
        { title: 'lost', number },
        { title: 'delay ms', number },
        { title: 'records', number },
      ],
      stats.agents.map(wayRow),
      'way-table',
    ),
  );
}

function clockText(depth_clock_ms: number | null): string {
  if (depth_clock_ms === null) return 'the clock of ToF is not judged yet';
  if (depth_clock_ms === 0) return 'the clock of ToF is right within 2 ms';
  return `the clock of ToF is put right by ${depth_clock_ms.toFixed(1)} ms`;
}

function agents(stats: Stats): HTMLElement {
  if (stats.agents.length === 0) return part('Agents', 'none heard');
  const number = true;
  return part(
    'Agents',
    `pictures a second, milliseconds; ${clockText(stats.depth_clock_ms)}`,
    table(
      [
        { title: 'name' },
        { title: 'heard', number },
        { title: 'colour', number },
        { title: 'ToF', number },
        { title: 'encode', number },
        { title: 'queue', number },
        { title: 'drops', number },
      ],
      stats.agents.map(agentRow),
      'agents-table',
    ),
  );
}

function trouble(reason: string): Node[] {
  return [el('dt', { text: 'last trouble' }), el('dd', { class: 'wide', text: reason })];
}

function page(stats: Stats, status: Status, room: RoomCounts | null): HTMLElement {
  const pair = (name: string, value: string): Node[] => [el('dt', { text: name }), el('dd', { text: value })];
  return part(
    'This page',
    `${count(stats.viewers)} ${stats.viewers === 1 ? 'viewer' : 'viewers'} connected`,
    el(
      'dl',
      { class: 'facts' },
      ...pair('pictures shown', count(status.color_frames)),
      ...pair(
        'streams',
        status.wanted.map((stream) => (stream === 'color' ? 'colour' : stream)).join(', ') || 'none',
      ),
      ...pair('round trip', `${fixed(status.round_trip_ms, 1)} ms`),
      ...pair('decoder restarts', count(status.restarts)),
      ...pair('messages refused', count(status.refused)),
      ...(room === null
        ? []
        : [
            ...pair('3D triangles', count(room.triangles)),
            ...pair('3D drawn in', `${fixed(room.draw_ms, 1)} ms`),
            ...pair('meshes skipped', count(room.superseded)),
            ...pair('meshes refused', count(room.refused)),
          ]),
      ...(room === null || room.last_trouble === '' ? [] : trouble(room.last_trouble)),
      ...(status.last_trouble === '' ? [] : trouble(status.last_trouble)),
    ),
  );
}

const kLeastWidth_px = 400;

/** Opens from the top bar's numbers, over the strip and not over the program. */
export class DetailsPanel {
  readonly root: HTMLElement;
  readonly close_button: HTMLButtonElement;
  readonly #content = el('div', { class: 'details-content' });

  constructor() {
    this.close_button = el(
      'button',
      { class: 'bar-button', attributes: { type: 'button', 'aria-label': 'Close details' } },
      icon('close'),
    );
    this.root = el(
      'aside',
      { class: 'details', testid: 'details', attributes: { id: 'details', 'aria-label': 'Details' } },
      el('header', { class: 'details-head' }, el('h2', { text: 'Details' }), this.close_button),
      this.#content,
    );
    this.root.hidden = true;
  }

  get open(): boolean {
    return !this.root.hidden;
  }

  set open(open: boolean) {
    this.root.hidden = !open;
  }

  /** As wide as the strip that it covers, but never too narrow for its tables. */
  set width_px(width_px: number) {
    this.root.style.width = `${Math.max(kLeastWidth_px, Math.round(width_px))}px`;
  }

  update(stats: Stats | null, status: Status, room: RoomCounts | null): void {
    if (!this.open) return;
    if (stats === null) {
      this.#content.replaceChildren(
        el('p', { class: 'quiet', text: 'The server has sent no statistics yet.' }),
      );
      return;
    }
    this.#content.replaceChildren(
      stages(stats),
      latency(stats, status),
      drops(stats),
      contacts(stats),
      agents(stats),
      ...(stats.agents.length > 0 ? [way(stats)] : []),
      page(stats, status, room),
    );
  }
}
