// SPDX-License-Identifier: Apache-2.0
import { admit, type Admission } from './admission';
import { Backoff } from './backoff';
import { decodeControlMessage, type ControlMessage, type ViewerMessage } from './control_message';
import { decodeLightMessage, isLightMessage, type LightMessage } from './light_message';
import { decodeMeshMessage, isMeshMessage, type MeshMessage } from './mesh_message';
import { decodePictureMessage, type PictureMessage } from './picture_message';

/**
 * `attempt` counts the attempts since the last hello; 0 is the very first. In `login` and `wrong_token` nothing
 * happens until a token is given.
 */
export type Link = {
  phase: 'connecting' | 'open' | 'waiting' | 'login' | 'wrong_token';
  attempt: number;
};

export interface WatchHandlers {
  onLink(link: Link): void;
  onPicture(picture: PictureMessage, message_bytes: number): void;
  onMesh(mesh: MeshMessage, message_bytes: number): void;
  onLight(light: LightMessage, message_bytes: number): void;
  onControl(message: ControlMessage): void;
  /** A message that was not believed. */
  onRefused(reason: string): void;
}

/** The part of WebSocket that is used, so that tests can stand in for it. */
export interface SocketLike {
  binaryType: BinaryType;
  readonly readyState: number;
  onopen: ((event: Event) => void) | null;
  onclose: ((event: CloseEvent) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: string): void;
  close(): void;
}

/** What the connection is made of, so that tests can stand in for it. */
export interface WatchParts {
  makeSocket(url: string): SocketLike;
  admit(url: string, token: string | null): Promise<Admission>;
}

const kBrowserParts: WatchParts = { makeSocket: (url) => new WebSocket(url), admit };

const kSocketOpen = 1;
// The server speaks at least twice a second: 4 s of silence is a dead peer that TCP has not noticed.
const kSilence_ms = 4000;
const kWatch_ms = 1000;

/** The connection to /watch: is let in, opens it, believes what passes the checks, comes back when it breaks. */
export class WatchSocket {
  readonly #url: string;
  readonly #handlers: WatchHandlers;
  readonly #parts: WatchParts;
  readonly #backoff = new Backoff();
  readonly #watchdog: ReturnType<typeof setInterval>;
  #socket: SocketLike | null = null;
  #retry: ReturnType<typeof setTimeout> | undefined;
  #heard_ms = 0;
  #token: string | null;
  /** Whom the token belongs to; empty without login. */
  #name = '';
  /** Counts the attempts to connect: an admission that comes after its attempt was given up is not used. */
  #attempt = 0;
  #closed = false;

  constructor(url: string, token: string | null, handlers: WatchHandlers, parts = kBrowserParts) {
    this.#url = url;
    this.#token = token;
    this.#handlers = handlers;
    this.#parts = parts;
    this.#watchdog = setInterval(() => this.#watch(), kWatch_ms);
    void this.#connect();
  }

  get name(): string {
    return this.#name;
  }

  /** Connects anew with this token; null: as nobody. */
  logIn(token: string | null): void {
    this.#token = token;
    this.#drop();
    void this.#connect();
  }

  /** False when nothing could be sent because the connection is down. */
  send(message: ViewerMessage): boolean {
    if (this.#socket?.readyState !== kSocketOpen) return false;
    this.#socket.send(JSON.stringify(message));
    return true;
  }

  close(): void {
    this.#closed = true;
    clearInterval(this.#watchdog);
    clearTimeout(this.#retry);
    this.#drop();
  }

  async #connect(): Promise<void> {
    clearTimeout(this.#retry);
    const attempt = ++this.#attempt;
    const attempts = this.#backoff.attempts;
    this.#handlers.onLink({ phase: 'connecting', attempt: attempts });
    const admission = await this.#parts.admit(this.#url, this.#token);
    if (attempt !== this.#attempt || this.#closed) return;
    if (admission.kind === 'later') return this.#broken();
    if (admission.kind === 'login' || admission.kind === 'wrong_token')
      return this.#handlers.onLink({ phase: admission.kind, attempt: attempts });
    this.#name = admission.kind === 'ticket' ? admission.name : '';
    this.#open(admission.kind === 'ticket' ? admission.ticket : null);
  }

  #open(ticket: string | null): void {
    this.#heard_ms = Date.now();
    const socket = this.#parts.makeSocket(this.#url);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => {
      if (ticket !== null) this.send({ type: 'ticket', ticket });
    };
    socket.onmessage = (event) => this.#receive(event.data);
    socket.onclose = () => this.#broken();
    this.#socket = socket;
  }

  #receive(data: unknown): void {
    this.#heard_ms = Date.now();
    if (data instanceof ArrayBuffer) {
      return this.#receiveBytes(new DataView(data));
    }
    const control = decodeControlMessage(String(data));
    if (!control.ok) return this.#handlers.onRefused(control.reason);
    if (control.value.type === 'hello') {
      this.#backoff.succeeded();
      this.#handlers.onLink({ phase: 'open', attempt: 0 });
    }
    this.#handlers.onControl(control.value);
  }

  #receiveBytes(view: DataView): void {
    if (isMeshMessage(view)) {
      const mesh = decodeMeshMessage(view);
      if (mesh.ok) this.#handlers.onMesh(mesh.value, view.byteLength);
      else this.#handlers.onRefused(`mesh: ${mesh.reason}`);
      return;
    }
    if (isLightMessage(view)) {
      const light = decodeLightMessage(view);
      if (light.ok) this.#handlers.onLight(light.value, view.byteLength);
      else this.#handlers.onRefused(`light: ${light.reason}`);
      return;
    }
    const picture = decodePictureMessage(view);
    if (picture.ok) this.#handlers.onPicture(picture.value, view.byteLength);
    else this.#handlers.onRefused(`picture: ${picture.reason}`);
  }

  #watch(): void {
    if (this.#socket !== null && Date.now() - this.#heard_ms > kSilence_ms) this.#broken();
  }

  #broken(): void {
    this.#drop();
    if (this.#closed) return;
    const wait_ms = this.#backoff.next_ms();
    this.#handlers.onLink({ phase: 'waiting', attempt: this.#backoff.attempts });
    this.#retry = setTimeout(() => void this.#connect(), wait_ms);
  }

  #drop(): void {
    const socket = this.#socket;
    this.#socket = null;
    if (socket === null) return;
    socket.onopen = null;
    socket.onmessage = null;
    socket.onclose = null;
    socket.close();
  }
}
