// SPDX-License-Identifier: Apache-2.0
import type { Hello } from '../transport/control_message';
import type { Scene } from '../transport/scene';
import type { Stats } from '../transport/stats';
import type { ProbePoint, ProbeReading } from '../view/depth_probe';
import type { Pose } from '../view/geometry';
import {
  kPaneNames,
  kPictureNames,
  type FromWorker,
  type MatteMode,
  type PaneName,
  type PictureName,
  type PictureSize,
  type Shown,
  type Status,
} from '../view/messages';
import { DepthScale } from './depth_scale';
import { DetailsPanel } from './details_panel';
import { el, setData, setText } from './dom';
import { EditSender } from './edit_sender';
import { Editor } from './editor';
import { HelpDialog } from './help_dialog';
import { icon } from './icons';
import { kScale_px, layoutOf, type Rect } from './layout';
import { LoginForm } from './login_form';
import { MatteControls } from './matte_controls';
import { Notice } from './notice';
import { editKeys, viewKeys, type PageActions } from './page_keys';
import { Pane } from './pane';
import { ProbeInput } from './probe_input';
import { ProgramInput } from './program_input';
import { publishReading, publishRoom, publishScene, publishState } from './published';
import { Rail } from './rail';
import { readingDetail, readingText } from './reading_text';
import { RingOverlay } from './ring_overlay';
import { RoomPane } from './room_pane';
import { ScanPanel } from './scan_panel';
import { SceneSection } from './scene_section';
import { listenForShortcuts } from './shortcuts';
import { kStaleAfter_s, stateOf } from './state_sentence';
import { browserParts, missingSupport } from './support';
import { storeToken, storedToken } from './token_store';
import { TopBar } from './top_bar';
import { WorkerLink, watchUrl } from './worker_link';

const kRailNeeds_px = { width: 264, height: 300 };
const kDefaultSize: PictureSize = { width: 1024, height: 768 };
const kNumbersEvery_ms = 500;
// The 3D view waits this long for a picture that may not come.
const kFirstPicture_ms = 1000;
const kProbeKeys = 'Arrow keys move the depth probe.';

/** The director's page: keeps what the workers say and what the person chose, and shows both. */
export class Page {
  readonly #bar = new TopBar();
  readonly #stage = el('main', { class: 'stage' });
  readonly #editor = new Editor(new EditSender((edit) => this.#worker?.send({ type: 'edit', edit })), {
    onChange: () => this.#showScene(),
    onNotice: (sentence, tone) => this.#scene.tell(sentence, tone),
  });
  readonly #room = new RoomPane(this.#editor, {
    onPose: (T_scene_color) => this.#placeCamera(T_scene_color),
    onShownChange: () => this.#show(),
  });
  readonly #panes: Readonly<Record<PaneName, Pane>> = {
    program: new Pane({
      name: 'program',
      title: 'Program',
      describes: 'Program picture',
      keys: `${kProbeKeys} Enter places an object there.`,
    }),
    depth: new Pane({
      name: 'depth',
      title: 'Depth',
      describes: 'Depth map',
      keys: kProbeKeys,
      side_px: kScale_px,
    }),
    matte: new Pane({ name: 'matte', title: 'Matte', describes: 'Matte of the actor', keys: kProbeKeys }),
    room: this.#room.pane,
  };
  readonly #notice = new Notice();
  readonly #scan = new ScanPanel();
  readonly #login = new LoginForm((token) => this.#logIn(token));
  readonly #ring = new RingOverlay();
  readonly #placing = el('p', { class: 'placing', testid: 'placing', attributes: { role: 'status' } });
  readonly #scale = new DepthScale();
  readonly #freeze_label = el('span', { text: 'Freeze' });
  readonly #freeze_button: HTMLButtonElement;
  readonly #matte_controls = new MatteControls((mode) => this.#setMode(mode));
  readonly #scene = new SceneSection(this.#editor);
  readonly #rail = new Rail((pane) => this.#togglePane(pane), this.#scene.root, this.#scene.parts);
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
    const actions = this.#actions();
    const shortcuts = [...viewKeys(actions), ...editKeys(this.#editor, actions)];
    const arrows = { label: 'Arrows', does: 'Move the depth probe, the 3D view or an object (Shift: finer)' };
    this.#help = new HelpDialog([...shortcuts.filter(({ does }) => does !== ''), arrows]);
    listenForShortcuts(shortcuts, ({ key }) => !this.#help.root.open || key === '?');
  }

  /** Builds the page into `host` and starts the worker. */
  start(host: HTMLElement): void {
    const { program, depth, matte } = this.#panes;
    depth.controls.append(this.#freeze_button);
    depth.body.append(this.#scale.root);
    matte.controls.append(this.#matte_controls.root);
    matte.frame.append(this.#matte_controls.legend);
    program.frame.append(this.#ring.root, this.#placing);
    this.#matte_controls.setMode(this.#mode);
    this.#stage.append(...kPaneNames.map((name) => this.#panes[name].root), this.#rail.root);
    host.append(this.#bar.root, this.#stage, this.#details.root, this.#help.root);

    this.#freeze_button.addEventListener('click', () => this.#toggleFreeze());
    this.#bar.details_button.addEventListener('click', () => this.#setDetails(!this.#details.open));
    this.#details.close_button.addEventListener('click', () => this.#setDetails(false));
    this.#bar.help_button.addEventListener('click', () => this.#help.toggle());
    this.#bar.logout_button.addEventListener('click', () => this.#logIn(null));
    new ProgramInput(program.frame, this.#editor, () => this.#size);
    for (const name of kPictureNames)
      new ProbeInput(
        this.#panes[name],
        () => this.#size,
        (point) => this.#probe(name, point),
      );
    document.addEventListener('visibilitychange', () => this.#show());
    new ResizeObserver(() => this.#show()).observe(this.#stage);

    this.#arrange();
    if (this.#unsupported === null) {
      const canvases = { program: program.canvas, depth: depth.canvas, matte: matte.canvas };
      const start = { url: watchUrl(location.href), token: storedToken(), shown: this.#shown };
      this.#worker = new WorkerLink(start, canvases, this.#room.session_port, {
        onMessage: (message) => this.#receive(message),
        onDead: (reason) => this.#workerDied(reason),
      });
    }
    this.#showScene();
    this.#refresh();
  }

  #actions(): PageActions {
    return {
      togglePane: (name) => this.#togglePane(name),
      setMode: (mode) => this.#setMode(mode),
      toggleFreeze: () => this.#toggleFreeze(),
      toggleFollow: () => this.#room.toggleFollow(),
      toggleDetails: () => this.#setDetails(!this.#details.open),
      toggleHelp: () => this.#help.toggle(),
      openAdd: () => this.#scene.openAdd(),
      escape: () => this.#escape(),
    };
  }

  #receive(message: FromWorker): void {
    switch (message.type) {
      case 'status':
        this.#takeStatus(message.status);
        break;
      case 'hello':
        this.#takeHello(message.hello);
        break;
      case 'stats':
        this.#stats = message.stats;
        this.#placeCamera(message.stats.T_scene_color);
        break;
      case 'scene':
        return this.#takeScene(message.scene);
      case 'refused':
        return this.#scene.tell(message.refused.reason, 'warning');
      case 'probe':
        return this.#takeReading(message.reading);
    }
    this.#refresh();
  }

  #takeStatus(status: Status): void {
    this.#status = status;
    if (status.color_frames > 0) this.#startRoom();
    // What the last server said is no news of the next.
    if (status.link.phase !== 'open') this.#stats = null;
    if (status.link.phase !== 'open' && this.#editor.scene !== null) this.#editor.forget();
    this.#editor.setUser(status.user);
    // A token that is not known here is not worth keeping.
    if (status.link.phase === 'wrong_token') storeToken(null);
    const size = status.size ?? this.#hello?.streams[0] ?? kDefaultSize;
    if (size.width === this.#size.width && size.height === this.#size.height) return;
    this.#size = { width: size.width, height: size.height };
    this.#show();
  }

  #takeHello(hello: Hello): void {
    this.#hello = hello;
    this.#was_open = true;
    this.#bar.setShow(hello.name);
    this.#editor.setHello(hello.role, hello.camera);
    if (hello.camera !== null) this.#room.setRig(hello.camera);
    setTimeout(() => this.#startRoom(), kFirstPicture_ms);
  }

  #startRoom(): void {
    if (this.#room.allowStart()) this.#show();
  }

  #takeScene(scene: Scene): void {
    this.#editor.setScene(scene);
    this.#room.setScene(scene);
  }

  #logIn(token: string | null): void {
    storeToken(token);
    this.#worker?.send({ type: 'login', token });
  }

  #takeReading(reading: ProbeReading | null): void {
    for (const name of kPictureNames)
      this.#panes[name].setReading(readingText(reading), readingDetail(reading));
    this.#scale.setMark(reading?.z_m ?? null);
    publishReading(document.documentElement, reading);
  }

  get #main(): PaneName {
    return kPaneNames.find((name) => this.#visible.has(name)) ?? 'program';
  }

  /** A page in a background tab shows nothing and so wants nothing. */
  get #shown(): Shown {
    const px = (name: PictureName): number => (document.hidden ? 0 : this.#panes[name].pane_px);
    const [program, depth, matte] = [px('program'), px('depth'), px('matte')];
    const room = document.hidden ? 0 : this.#room.shown_px;
    return { pane_px: { program, depth, matte, room }, mode: this.#mode };
  }

  #show(): void {
    this.#arrange();
    this.#room.show();
    this.#worker?.send({ type: 'show', shown: this.#shown });
  }

  #arrange(): void {
    const main = this.#main;
    const others = kPictureNames.filter((name) => name !== main && this.#visible.has(name));
    const { clientWidth: width, clientHeight: height } = this.#stage;
    const aspect = this.#size.width / this.#size.height;
    const room = main !== 'room' && this.#visible.has('room');
    const layout = layoutOf({ width, height, aspect, pictures: others.length, room, rail: kRailNeeds_px });
    for (const name of kPaneNames) this.#panes[name].visible = this.#visible.has(name);
    const place = (name: PictureName, rect: Rect | undefined): void => {
      const picture_height = rect === undefined ? 0 : this.#panes[name].place(rect, aspect);
      if (name === 'depth') this.#scale.resize(picture_height);
    };
    if (main === 'room') this.#room.place(layout.main);
    else place(main, layout.main);
    others.forEach((name, index) => place(name, layout.pictures[index]));
    if (layout.room !== null) this.#room.place(layout.room);
    this.#rail.place(layout.rail);
    if (layout.arrangement === 'beside') this.#details.width_px = layout.rail.width;
    this.#rail.setVisible(this.#visible);
    setData(this.#stage, 'arrangement', layout.arrangement);
    this.#panes[main].frame.append(this.#notice.root, this.#scan.root);
    this.#panes[main].body.append(this.#login.root);
  }

  #togglePane(name: PaneName): void {
    if (!this.#visible.has(name)) this.#visible.add(name);
    else if (this.#visible.size > 1) this.#visible.delete(name);
    this.#show();
  }

  #setMode(mode: MatteMode): void {
    this.#mode = mode;
    this.#matte_controls.setMode(mode);
    this.#panes.matte.title = { matte: 'Matte', label: 'Label', light: 'Light map' }[mode];
    this.#show();
  }

  #toggleFreeze(): void {
    this.#worker?.send({ type: 'freeze', frozen: (this.#status?.frozen_frame ?? null) === null });
  }

  #escape(): void {
    if (this.#details.open) this.#setDetails(false);
    else if (this.#editor.placing !== null) this.#editor.place(null);
    else this.#editor.select(null);
  }

  /** Scene, selection or role have changed. */
  #showScene(): void {
    const { scene, selected, placing } = this.#editor;
    this.#scene.update();
    this.#room.select(selected?.id ?? null);
    this.#panes.program.frame.classList.toggle('placing-here', placing !== null);
    this.#placing.hidden = placing === null;
    const what = placing?.what === 'add' ? placing.file : (selected?.name ?? 'it');
    const place = `Click where ${what} shall stand. Esc: not now.`;
    const adopt = 'Click the thing left behind, and nobody touch it for a second. Esc: not now.';
    setText(this.#placing, placing?.what === 'adopt' ? adopt : place);
    publishScene(document.documentElement, scene);
    this.#showRing();
  }

  /** Null: not known yet. */
  #placeCamera(T_scene_color: Pose | null): void {
    if (T_scene_color === null) return;
    this.#editor.setPose(T_scene_color);
    this.#showRing();
  }

  #showRing(): void {
    const { program_view, scene, selected } = this.#editor;
    const shown = selected !== null && !selected.hidden ? selected : null;
    this.#ring.show(program_view, shown?.base ?? null, shown?.radius_m ?? 0, scene?.up ?? [0, 0, 1]);
  }

  #setDetails(open: boolean): void {
    this.#details.open = open;
    this.#bar.details_button.setAttribute('aria-expanded', String(open));
    if (this.#status !== null) this.#details.update(this.#stats, this.#status, this.#room.counts);
  }

  #probe(from: PictureName, point: ProbePoint | null): void {
    for (const name of kPictureNames) this.#panes[name].setProbe(point, name === from);
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
    // With the 3D view alone no picture is waited for.
    const none_wanted = status?.wanted.every((stream) => stream === 'mesh') ?? false;
    const age_s = none_wanted ? 0 : (status?.color_age_s ?? status?.depth_age_s ?? null);
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
    publishRoom(document.documentElement, this.#room.counts);
    if (status === null) return;
    const { phase } = status.link;
    const asks = phase === 'login' || phase === 'wrong_token';
    this.#login.show(asks ? { wrong: phase === 'wrong_token' } : null);
    this.#bar.setUser(phase === 'open' ? status.user : '', this.#hello?.role ?? 'viewer');
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
    this.#scan.show(this.#stats?.scan ?? null);
    this.#rail.setRecording(this.#stats?.recording ?? null);
    this.#rail.setAgents(status.link.phase === 'open' ? (this.#stats?.agents ?? []) : []);
    const now_ms = performance.now();
    if (now_ms - this.#numbers_ms < kNumbersEvery_ms) return;
    this.#numbers_ms = now_ms;
    this.#bar.setNumbers(status, this.#stats, fresh);
    this.#details.update(this.#stats, status, this.#room.counts);
  }

  #showFrozen(frame: string | null): void {
    this.#freeze_button.setAttribute('aria-pressed', String(frame !== null));
    setText(this.#freeze_label, frame === null ? 'Freeze' : `Frozen at ${frame}`);
  }
}
