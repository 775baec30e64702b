// SPDX-License-Identifier: Apache-2.0
import type { FromRoom, Look, ToRoom } from '../view/room_messages';

export interface RoomHandlers {
  onMessage(message: FromRoom): void;
  /** The worker is gone and will not come back. */
  onDead(reason: string): void;
}

/** The page's end of the 3D pane's worker: hands the canvas over and passes messages. */
export class RoomLink {
  readonly #worker: Worker;

  constructor(canvas: HTMLCanvasElement, meshes: MessagePort, look: Look, handlers: RoomHandlers) {
    this.#worker = new Worker(new URL('../view/room_worker.ts', import.meta.url), {
      type: 'module',
      name: 'mixstage-room',
    });
    this.#worker.onmessage = (event: MessageEvent<FromRoom>) => handlers.onMessage(event.data);
    this.#worker.onerror = (event) => handlers.onDead(event.message);
    const handed = canvas.transferControlToOffscreen();
    this.#post({ type: 'start', canvas: handed, meshes, look }, [handed, meshes]);
  }

  send(message: Exclude<ToRoom, { type: 'start' }>): void {
    this.#post(message);
  }

  #post(message: ToRoom, transfer: Transferable[] = []): void {
    this.#worker.postMessage(message, transfer);
  }
}
