// SPDX-License-Identifier: Apache-2.0
import type { Hello } from '../transport/control_message';
import type { Stats } from '../transport/stats';
import type { ProbePoint, ProbeReading } from '../view/depth_probe';
import {
  kPaneNames,
  type FromWorker,
  type MatteMode,
  type PaneName,
  type PictureSize,
  type Shown,
  type Status,
} from '../view/messages';
import { DepthScale } from './depth_scale';
import { DetailsPanel } from './details_panel';
import { el, setData, setText } from './dom';
import { HelpDialog } from './help_dialog';
import { icon } from './icons';
import { kScale_px, layoutOf } from './layout';
import { MatteControls } from './matte_controls';
import { Notice } from './notice';
import { Pane } from './pane';
import { ProbeInput } from './probe_input';
import { publishReading, publishState } from './published';
import { Rail } from './rail';
import { readingDetail, readingText } from './reading_text';
import { listenForShortcuts, type Shortcut } from './shortcuts';
import { kStaleAfter_s, stateOf } from './state_sentence';
import { browserParts, missingSupport } from './support';
import { TopBar } from './top_bar';
import { WorkerLink, watchUrl } from './worker_link';

const kRailNeeds_px = { width: 296, height: 132 };
const kDefaultSize: PictureSize = { width: 1024, height: 768 };
const kNumbersEvery_ms = 500;

/** The director's page: keeps what the worker says and what the person chose, and shows both. */
export class Page {
  readonly #bar = new TopBar();
  readonly #stage = el('main', { class: 'stage' });
  readonly #panes: Readonly<Record<PaneName, Pane>> = {
    program: new Pane({ name: 'program', title: 'Program', describes: 'Program picture' }),
    depth: new Pane({ name: 'depth', title: 'Depth', describes: 'Depth map', side_px: kScale_px }),
    matte: new Pane({ name: 'matte', title: 'Matte', describes: 'Matte of the actor' }),
  };
  readonly #notice = new Notice();
  readonly #scale = new DepthScale();
  readonly #freeze_label = el('span', { text: 'Freeze' });
  readonly #freeze_button: HTMLButtonElement;
  readonly #matte_controls = new MatteControls((mode) => this.#setMode(mode));
  readonly #rail = new Rail((pane) => this.#togglePane(pane));
  readonly #details = new DetailsPanel();
  readonly #help: HelpDialog;
  readonly #visible = new Set<PaneName>(kPaneNames);
  #unsupported = missingSupport(browserParts());
  #worker: WorkerLink | null = null;
  #mode: MatteMode = 'matte';
  #size = kDefaultSize;
  #status: Status | null = null;
  #hello: Hello | null = null;
  #stats: Stats | null = null;
  #was_open = false;
  #numbers_ms = 0;

  constructor() {
    this.#freeze_button = el(
      'button',
      {
        class: 'segment-button',
        testid: 'freeze',
        attributes: { type: 'button', title: 'Freeze the depth map (Space)', 'aria-pressed': 'false' },
      },
      icon('pause'),
      this.#freeze_label,
    );
    const shortcuts = this.#shortcuts();
    const arrows = { label: 'Arrows', does: 'Move the depth probe in the focused picture (Shift: faster)' };
    this.#help = new HelpDialog([...shortcuts, arrows]);
    listenForShortcuts(shortcuts, ({ key }) => !this.#help.root.open || key === '?');
  }

  /** Builds the page into `host` and starts the worker. */
  start(host: HTMLElement): void {
    const { depth, matte } = this.#panes;
    depth.controls.append(this.#freeze_button);
    depth.body.append(this.#scale.root);
    matte.controls.append(this.#matte_controls.root);
    matte.frame.append(this.#matte_controls.legend);
    this.#matte_controls.setMode(this.#mode);
    this.#stage.append(...kPaneNames.map((name) => this.#panes[name].root), this.#rail.root);
    host.append(this.#bar.root, this.#stage, this.#details.root, this.#help.root);

    this.#freeze_button.addEventListener('click', () => this.#toggleFreeze());
    this.#bar.details_button.addEventListener('click', () => this.#setDetails(!this.#details.open));
    this.#details.close_button.addEventListener('click', () => this.#setDetails(false));
    this.#bar.help_button.addEventListener('click', () => this.#help.toggle());
    for (const name of kPaneNames)
      new ProbeInput(
        this.#panes[name],
        () => this.#size,
        (point) => this.#probe(name, point),
      );
    document.addEventListener('visibilitychange', () => this.#show());
    new ResizeObserver(() => this.#show()).observe(this.#stage);

    this.#arrange();
    if (this.#unsupported === null) {
      const canvases = { program: this.#panes.program.canvas, depth: depth.canvas, matte: matte.canvas };
      this.#worker = new WorkerLink(watchUrl(location.href), canvases, this.#shown, {
        onMessage: (message) => this.#receive(message),
        onDead: (reason) => this.#workerDied(reason),
      });
    }
    this.#refresh();
  }

  #shortcuts(): Shortcut[] {
    const pane = (name: PaneName, key: string): Shortcut => ({
      key,
      label: key,
      does: `Show or hide the ${name} pane`,
      run: () => this.#togglePane(name),
    });
    return [
      pane('program', '1'),
      pane('depth', '2'),
      pane('matte', '3'),
      {
        key: 'm',
        label: 'M',
        does: 'Matte: the actor over a checkerboard',
        run: () => this.#setMode('matte'),
      },
      {
        key: 'l',
        label: 'L',
        does: 'Label: what each pixel was taken for',
        run: () => this.#setMode('label'),
      },
      {
        key: ' ',
        label: 'Space',
        does: 'Freeze the depth map, or let it go on',
        run: () => this.#toggleFreeze(),
      },
      {
        key: 'i',
        label: 'I',
        does: 'Details: times, drops, agents',
        run: () => this.#setDetails(!this.#details.open),
      },
      { key: '?', label: '?', does: 'This list', run: () => this.#help.toggle() },
      { key: 'Escape', label: 'Esc', does: 'Close what is open', run: () => this.#setDetails(false) },
    ];
  }

  #receive(message: FromWorker): void {
    switch (message.type) {
      case 'status':
        this.#takeStatus(message.status);
        break;
      case 'hello':
        this.#hello = message.hello;
        this.#was_open = true;
        this.#bar.setShow(message.hello.name);
        break;
      case 'stats':
        this.#stats = message.stats;
        break;
      case 'probe':
        return this.#takeReading(message.reading);
    }
    this.#refresh();
  }

  #takeStatus(status: Status): void {
    this.#status = status;
    // What the last server said is no news of the next.
    if (status.link.phase !== 'open') this.#stats = null;
    const size = status.size ?? this.#hello?.streams[0] ?? kDefaultSize;
    if (size.width === this.#size.width && size.height === this.#size.height) return;
    this.#size = { width: size.width, height: size.height };
    this.#show();
  }

  #takeReading(reading: ProbeReading | null): void {
    for (const name of kPaneNames) this.#panes[name].setReading(readingText(reading), readingDetail(reading));
    this.#scale.setMark(reading?.z_m ?? null);
    publishReading(document.documentElement, reading);
  }

  get #main(): PaneName {
    return kPaneNames.find((name) => this.#visible.has(name)) ?? 'program';
  }

  /** A page in a background tab shows nothing and so wants nothing. */
  get #shown(): Shown {
    const px = (name: PaneName): number => (document.hidden ? 0 : this.#panes[name].pane_px);
    return { pane_px: { program: px('program'), depth: px('depth'), matte: px('matte') }, mode: this.#mode };
  }

  #show(): void {
    this.#arrange();
    this.#worker?.send({ type: 'show', shown: this.#shown });
  }

  #arrange(): void {
    const main = this.#main;
    const others = kPaneNames.filter((name) => name !== main && this.#visible.has(name));
    const { clientWidth: width, clientHeight: height } = this.#stage;
    const aspect = this.#size.width / this.#size.height;
    const layout = layoutOf({ width, height, aspect, panes: others.length, rail: kRailNeeds_px });
    for (const name of kPaneNames) this.#panes[name].visible = this.#visible.has(name);
    const place = (name: PaneName, rect: (typeof layout)['main'] | undefined): void => {
      const picture_height = rect === undefined ? 0 : this.#panes[name].place(rect, aspect);
      if (name === 'depth') this.#scale.resize(picture_height);
    };
    place(main, layout.main);
    others.forEach((name, index) => place(name, layout.panes[index]));
    this.#rail.place(layout.rail);
    if (layout.arrangement === 'beside') this.#details.width_px = layout.rail.width;
    this.#rail.setVisible(this.#visible);
    setData(this.#stage, 'arrangement', layout.arrangement);
    this.#panes[main].frame.append(this.#notice.root);
  }

  #togglePane(name: PaneName): void {
    if (!this.#visible.has(name)) this.#visible.add(name);
    else if (this.#visible.size > 1) this.#visible.delete(name);
    this.#show();
  }

  #setMode(mode: MatteMode): void {
    this.#mode = mode;
    this.#matte_controls.setMode(mode);
    this.#panes.matte.title = mode === 'matte' ? 'Matte' : 'Label';
    this.#show();
  }

  #toggleFreeze(): void {
    this.#worker?.send({ type: 'freeze', frozen: (this.#status?.frozen_frame ?? null) === null });
  }

  #setDetails(open: boolean): void {
    this.#details.open = open;
    this.#bar.details_button.setAttribute('aria-expanded', String(open));
    if (this.#status !== null) this.#details.update(this.#stats, this.#status);
  }

  #probe(from: PaneName, point: ProbePoint | null): void {
    for (const name of kPaneNames) this.#panes[name].setProbe(point, name === from);
    this.#worker?.send({ type: 'probe', point });
  }

  #workerDied(reason: string): void {
    this.#unsupported = {
      sentence: `The page's decoder stopped: ${reason || 'it could not be loaded'}.`,
      advice: 'Reload the page.',
    };
    this.#refresh();
  }

  #refresh(): void {
    const status = this.#status;
    const age_s = status?.color_age_s ?? status?.depth_age_s ?? null;
    const state = stateOf({
      unsupported: this.#unsupported,
      link: status?.link ?? { phase: 'connecting', attempt: 0 },
      was_open: this.#was_open,
      protocol: this.#hello?.protocol ?? null,
      stats: this.#stats,
      picture: { age_s },
      undecodable: status?.undecodable.color ?? null,
    });
    const fresh = age_s !== null && age_s <= kStaleAfter_s && status?.link.phase === 'open';
    this.#bar.setState(state);
    this.#notice.show(state, fresh);
    document.title = `${state.word}${this.#hello === null ? '' : ` · ${this.#hello.name}`} · MixStage`;
    publishState(document.documentElement, state, status);
    if (status === null) return;
    const stale = (age: number | null): number | null => (age !== null && age > kStaleAfter_s ? age : null);
    this.#panes.program.setStale(stale(status.color_age_s));
    const depth_stale = status.frozen_frame === null ? stale(status.depth_age_s) : null;
    this.#panes.depth.setStale(depth_stale);
    this.#panes.matte.setStale(stale(status.matte_age_s));
    const codec = status.undecodable.depth;
    const advice = 'Open the page in Chromium, Chrome or Edge.';
    const note = codec === undefined ? '' : `This browser cannot decode 10-bit H.264 (${codec}). ${advice}`;
    this.#panes.depth.setNote(note);
    this.#panes.matte.setNote(note);
    this.#scale.setRange(status.range);
    this.#showFrozen(status.frozen_frame);
    this.#rail.setAgents(status.link.phase === 'open' ? (this.#stats?.agents ?? []) : []);
    const now_ms = performance.now();
    if (now_ms - this.#numbers_ms < kNumbersEvery_ms) return;
    this.#numbers_ms = now_ms;
    this.#bar.setNumbers(status, this.#stats, fresh);
    this.#details.update(this.#stats, status);
  }

  #showFrozen(frame: string | null): void {
    this.#freeze_button.setAttribute('aria-pressed', String(frame !== null));
    setText(this.#freeze_label, frame === null ? 'Freeze' : `Frozen at ${frame}`);
  }
}
