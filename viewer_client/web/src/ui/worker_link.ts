// SPDX-License-Identifier: Apache-2.0
import type { FromWorker, PictureName, Shown, ToWorker } from '../view/messages';

export interface WorkerHandlers {
  onMessage(message: FromWorker): void;
  /** The worker is gone and will not come back. */
  onDead(reason: string): void;
}

/** The page's end of the worker: hands the canvases over and passes messages. */
export class WorkerLink {
  readonly #worker: Worker;

  constructor(
    { url, token, shown }: { url: string; token: string | null; shown: Shown },
    canvases: Record<PictureName, HTMLCanvasElement>,
    meshes: MessagePort,
    handlers: WorkerHandlers,
  ) {
    this.#worker = new Worker(new URL('../view/worker.ts', import.meta.url), {
      type: 'module',
      name: 'mixstage',
    });
    this.#worker.onmessage = (event: MessageEvent<FromWorker>) => handlers.onMessage(event.data);
    this.#worker.onerror = (event) => handlers.onDead(event.message);
    const handed = {
      program: canvases.program.transferControlToOffscreen(),
      depth: canvases.depth.transferControlToOffscreen(),
      matte: canvases.matte.transferControlToOffscreen(),
    };
    const start: ToWorker = { type: 'start', url, token, canvases: handed, shown };
    this.#worker.postMessage(start, [handed.program, handed.depth, handed.matte]);
    const port: ToWorker = { type: 'meshes', port: meshes };
    this.#worker.postMessage(port, [meshes]);
  }

  send(message: Exclude<ToWorker, { type: 'start' | 'meshes' }>): void {
    this.#worker.postMessage(message);
  }
}

/** The watch address beside the page's own: behind a proxy the page may live below a path. */
export function watchUrl(page: string): string {
  const url = new URL('watch', page);
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
  url.search = '';
  url.hash = '';
  return url.href;
}
