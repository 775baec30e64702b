// SPDX-License-Identifier: Apache-2.0
import type { AgentHealth, Recording } from '../transport/stats';
import { kPaneNames, type PaneName } from '../view/messages';
import { el, setData, setText } from './dom';
import type { Rect } from './layout';
import { count, fixed, span } from './numbers';

const kTitles: Readonly<Record<PaneName, string>> = {
  program: 'Program',
  depth: 'Depth',
  matte: 'Matte',
  room: '3D',
};
// Health comes at 1 Hz: an agent that missed three is not well.
const kSilentAfter_s = 3;
// Parity of the default strength mends up to about this share of datagrams.
const kLossy = 0.02;

/** What the way from the rig costs, each part unbroken: empty where the server knows nothing of it. */
function wayText({ slice_loss, repaired, lost, delay_ms }: AgentHealth): string {
  const parts = [
    slice_loss === null ? '' : `loss\u00a0${fixed(100 * slice_loss, 1)}\u00a0%`,
    repaired === null ? '' : `${count(repaired)}\u00a0repaired`,
    repaired === null && lost === 0 ? '' : `${count(lost)}\u00a0lost`,
    delay_ms === null ? '' : `${fixed(delay_ms, 1)}\u00a0ms\u00a0late`,
  ];
  return parts.filter((part) => part !== '').join('  ');
}

/** The controls: the scene, which panes are shown, and how the rig's machines are. */
export class Rail {
  readonly root: HTMLElement;
  readonly #toggles = new Map<PaneName, HTMLButtonElement>();
  readonly #agents = el('ul', { class: 'agents', testid: 'agents' });
  readonly #nobody = el('p', { class: 'quiet', text: 'No agent has been heard.' });

  readonly #recording = el('span', { class: 'recording', testid: 'recording' });

  constructor(onToggle: (pane: PaneName) => void, scene: HTMLElement, parts: readonly HTMLElement[]) {
    this.#recording.hidden = true;
    const toggles = kPaneNames.map((pane, index) => {
      const button = el(
        'button',
        {
          class: 'toggle',
          testid: `toggle-${pane}`,
          attributes: { type: 'button', title: `Show or hide ${kTitles[pane]} (${index + 1})` },
        },
        el('span', { text: kTitles[pane] }),
        el('kbd', { text: `${index + 1}` }),
      );
      button.addEventListener('click', () => onToggle(pane));
      this.#toggles.set(pane, button);
      return button;
    });
    this.root = el(
      'aside',
      { class: 'rail', attributes: { 'aria-label': 'Scene, views and rig' } },
      el(
        'div',
        { class: 'rail-parts' },
        scene,
        el(
          'div',
          { class: 'rail-column' },
          ...parts,
          el(
            'section',
            { class: 'rail-part' },
            el('h2', { class: 'rail-title', text: 'Views' }),
            el('div', { class: 'toggles' }, ...toggles),
          ),
          el(
            'section',
            { class: 'rail-part' },
            el(
              'div',
              { class: 'rail-head' },
              el('h2', { class: 'rail-title', text: 'Rig' }),
              this.#recording,
            ),
            this.#agents,
            this.#nobody,
          ),
        ),
      ),
    );
  }

  place(rect: Rect): void {
    this.root.style.left = `${rect.x}px`;
    this.root.style.top = `${rect.y}px`;
    this.root.style.width = `${rect.width}px`;
    this.root.style.height = `${rect.height}px`;
  }

  /** The last visible pane cannot be hidden: its button says so. */
  setVisible(visible: ReadonlySet<PaneName>): void {
    for (const [pane, button] of this.#toggles) {
      const on = visible.has(pane);
      button.setAttribute('aria-pressed', String(on));
      button.setAttribute('aria-disabled', String(on && visible.size === 1));
    }
  }

  setAgents(agents: readonly AgentHealth[]): void {
    this.#nobody.hidden = agents.length > 0;
    while (this.#agents.children.length > agents.length) this.#agents.lastElementChild?.remove();
    agents.forEach((agent, index) => this.#row(index, agent));
  }

  /** Null: not known, or nothing is recorded. */
  setRecording(recording: Recording | null): void {
    this.#recording.hidden = recording?.active !== true;
    if (recording === null) return;
    const dropped = recording.dropped === 0 ? '' : `, ${count(recording.dropped)} dropped`;
    setText(this.#recording, `recording ${span(recording.seconds)}${dropped}`);
    setData(this.#recording, 'tone', recording.dropped === 0 ? 'live' : 'warning');
  }

  #row(index: number, agent: AgentHealth): void {
    let row = this.#agents.children[index] as HTMLElement | undefined;
    if (row === undefined) {
      row = el(
        'li',
        { class: 'agent' },
        el('span', { class: 'agent-name' }),
        el('span', { class: 'agent-record', text: 'REC' }),
        el('span', { class: 'agent-rates' }),
        el('span', { class: 'agent-way' }),
      );
      this.#agents.append(row);
    }
    const [name, record, rates, way] = row.children as unknown as [
      HTMLElement,
      HTMLElement,
      HTMLElement,
      HTMLElement,
    ];
    const silent = agent.age_s > kSilentAfter_s;
    setData(row, 'tone', silent ? 'alarm' : 'live');
    setText(name, agent.name);
    record.hidden = agent.recording !== true || silent;
    const text = silent ? '' : wayText(agent);
    setText(way, text);
    way.hidden = text === '';
    setData(way, 'tone', (agent.slice_loss ?? 0) > kLossy ? 'warning' : 'live');
    setText(
      rates,
      silent
        ? `silent for ${span(agent.age_s)}`
        : `colour ${fixed(agent.color_fps, 1)}  ToF ${fixed(agent.depth_fps, 1)} fps`,
    );
  }
}
