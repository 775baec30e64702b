// SPDX-License-Identifier: Apache-2.0
import type { AgentHealth } from '../transport/stats';
import { kPaneNames, type PaneName } from '../view/messages';
import { el, setData, setText } from './dom';
import type { Rect } from './layout';
import { fixed, span } from './numbers';

const kTitles: Readonly<Record<PaneName, string>> = { program: 'Program', depth: 'Depth', matte: 'Matte' };
// Health comes at 1 Hz: an agent that missed three is not well.
const kSilentAfter_s = 3;

/** The controls: which panes are shown, and how the rig's machines are. */
export class Rail {
  readonly root: HTMLElement;
  readonly #toggles = new Map<PaneName, HTMLButtonElement>();
  readonly #agents = el('ul', { class: 'agents', testid: 'agents' });
  readonly #nobody = el('p', { class: 'quiet', text: 'No agent has been heard.' });

  constructor(onToggle: (pane: PaneName) => void) {
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
      { class: 'rail', attributes: { 'aria-label': 'Views and rig' } },
      el(
        'section',
        { class: 'rail-part' },
        el('h2', { class: 'rail-title', text: 'Views' }),
        el('div', { class: 'toggles' }, ...toggles),
      ),
      el(
        'section',
        { class: 'rail-part' },
        el('h2', { class: 'rail-title', text: 'Rig' }),
        this.#agents,
        this.#nobody,
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

  #row(index: number, agent: AgentHealth): void {
    let row = this.#agents.children[index] as HTMLElement | undefined;
    if (row === undefined) {
      row = el(
        'li',
        { class: 'agent' },
        el('span', { class: 'agent-name' }),
        el('span', { class: 'agent-rates' }),
      );
      this.#agents.append(row);
    }
    const [name, rates] = row.children as unknown as [HTMLElement, HTMLElement];
    const silent = agent.age_s > kSilentAfter_s;
    setData(row, 'tone', silent ? 'alarm' : 'live');
    setText(name, agent.name);
    setText(
      rates,
      silent
        ? `silent for ${span(agent.age_s)}`
        : `colour ${fixed(agent.color_fps, 1)}  ToF ${fixed(agent.depth_fps, 1)} fps`,
    );
  }
}
