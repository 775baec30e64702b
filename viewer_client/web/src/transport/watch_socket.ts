// SPDX-License-Identifier: Apache-2.0
import { Backoff } from './backoff';
import { decodeControlMessage, type ControlMessage, type ViewerMessage } from './control_message';
import { decodePictureMessage, type PictureMessage } from './picture_message';

/** `attempt` counts the attempts since the last hello; 0 is the very first. */
export type Link = { phase: 'connecting' | 'open' | 'waiting'; attempt: number };

export interface WatchHandlers {
  onLink(link: Link): void;
  onPicture(picture: PictureMessage, message_bytes: number): void;
  onControl(message: ControlMessage): void;
  /** A message that was not believed. */
  onRefused(reason: string): void;
}

/** The part of WebSocket that is used, so that tests can stand in for it. */
export interface SocketLike {
  binaryType: BinaryType;
  readonly readyState: number;
  onclose: ((event: CloseEvent) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: string): void;
  close(): void;
}

const kSocketOpen = 1;
// The server speaks at least twice a second: 4 s of silence is a dead peer that TCP has not noticed.
const kSilence_ms = 4000;
const kWatch_ms = 1000;

/** The connection to /watch: opens it, believes what passes the checks, comes back when it breaks. */
export class WatchSocket {
  readonly #url: string;
  readonly #handlers: WatchHandlers;
  readonly #makeSocket: (url: string) => SocketLike;
  readonly #backoff = new Backoff();
  readonly #watchdog: ReturnType<typeof setInterval>;
  #socket: SocketLike | null = null;
  #retry: ReturnType<typeof setTimeout> | undefined;
  #heard_ms = 0;
  #closed = false;

  constructor(
    url: string,
    handlers: WatchHandlers,
    makeSocket: (url: string) => SocketLike = (to) => new WebSocket(to),
  ) {
    this.#url = url;
    this.#handlers = handlers;
    this.#makeSocket = makeSocket;
    this.#watchdog = setInterval(() => this.#watch(), kWatch_ms);
    this.#connect();
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

  #connect(): void {
    this.#handlers.onLink({ phase: 'connecting', attempt: this.#backoff.attempts });
    this.#heard_ms = Date.now();
    const socket = this.#makeSocket(this.#url);
    socket.binaryType = 'arraybuffer';
    socket.onmessage = (event) => this.#receive(event.data);
    socket.onclose = () => this.#broken();
    this.#socket = socket;
  }

  #receive(data: unknown): void {
    this.#heard_ms = Date.now();
    if (data instanceof ArrayBuffer) {
      const picture = decodePictureMessage(new DataView(data));
      if (picture.ok) this.#handlers.onPicture(picture.value, data.byteLength);
      else this.#handlers.onRefused(`picture: ${picture.reason}`);
      return;
    }
    const control = decodeControlMessage(String(data));
    if (!control.ok) return this.#handlers.onRefused(control.reason);
    if (control.value.type === 'hello') {
      this.#backoff.succeeded();
      this.#handlers.onLink({ phase: 'open', attempt: 0 });
    }
    this.#handlers.onControl(control.value);
  }

  #watch(): void {
    if (this.#socket !== null && Date.now() - this.#heard_ms > kSilence_ms) this.#broken();
  }

  #broken(): void {
    this.#drop();
    if (this.#closed) return;
    const wait_ms = this.#backoff.next_ms();
    this.#handlers.onLink({ phase: 'waiting', attempt: this.#backoff.attempts });
    this.#retry = setTimeout(() => this.#connect(), wait_ms);
  }

  #drop(): void {
    const socket = this.#socket;
    this.#socket = null;
    if (socket === null) return;
    socket.onmessage = null;
    socket.onclose = null;
    socket.close();
  }
}
