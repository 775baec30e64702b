// SPDX-License-Identifier: Apache-2.0
import type { DepthRange } from './depth_code';
import type { DepthPicture, Plane } from './depth_picture';
import { PlanePool } from './plane_pool';

export interface DepthFrameInfo {
  frame: bigint;
  capture_us: bigint;
  range: DepthRange;
}

function plane(
  memory: ArrayBuffer,
  layout: PlaneLayout | undefined,
  width: number,
  height: number,
): Plane | null {
  if (layout === undefined || layout.offset % 2 !== 0 || layout.stride % 2 !== 0) return null;
  const stride = layout.stride / 2;
  if (stride < width || layout.offset + 2 * stride * height > memory.byteLength) return null;
  return { samples: new Uint16Array(memory, layout.offset, stride * height), stride, width, height };
}

/**
 * Copies the exact codes out of decoded frames. One copy is under way at a time; of frames that come meanwhile
 * the newest waits and the others are closed: a late picture is worth nothing. Closes every frame it is given.
 */
export class DepthReader {
  readonly #pool = new PlanePool();
  readonly #onPicture: (picture: DepthPicture) => void;
  readonly #onTrouble: (reason: string) => void;
  #waiting: { frame: VideoFrame; info: DepthFrameInfo } | null = null;
  #busy = false;
  #closed = false;

  constructor(onPicture: (picture: DepthPicture) => void, onTrouble: (reason: string) => void) {
    this.#onPicture = onPicture;
    this.#onTrouble = onTrouble;
  }

  push(frame: VideoFrame, info: DepthFrameInfo): void {
    this.#waiting?.frame.close();
    this.#waiting = { frame, info };
    if (!this.#busy) void this.#drain();
  }

  close(): void {
    this.#closed = true;
    this.#waiting?.frame.close();
    this.#waiting = null;
  }

  async #drain(): Promise<void> {
    this.#busy = true;
    while (this.#waiting !== null) {
      const { frame, info } = this.#waiting;
      this.#waiting = null;
      try {
        const picture = await this.#read(frame, info);
        if (this.#closed) picture?.release();
        else if (picture !== null) this.#onPicture(picture);
      } catch (error) {
        this.#onTrouble(`depth copy: ${error instanceof Error ? error.message : String(error)}`);
      } finally {
        frame.close();
      }
    }
    this.#busy = false;
  }

  async #read(frame: VideoFrame, info: DepthFrameInfo): Promise<DepthPicture | null> {
    // The type of lib.dom does not know the 10-bit formats yet.
    const format: string | null = frame.format;
    if (format !== 'I420P10') {
      this.#onTrouble(`depth decoder gives ${format ?? 'opaque frames'}, not I420P10`);
      return null;
    }
    const visible = frame.visibleRect;
    const width = visible?.width ?? frame.codedWidth;
    const height = visible?.height ?? frame.codedHeight;
    const memory = this.#pool.take(frame.allocationSize());
    const layouts = await frame.copyTo(memory);
    const half_width = (width + 1) >> 1;
    const half_height = (height + 1) >> 1;
    const depth = plane(memory, layouts[0], width, height);
    const coverage = plane(memory, layouts[1], half_width, half_height);
    const label = plane(memory, layouts[2], half_width, half_height);
    if (depth === null || coverage === null || label === null) {
      this.#pool.give(memory);
      this.#onTrouble('depth decoder gives planes that do not fit their memory');
      return null;
    }
    let held = true;
    const release = (): void => {
      if (held) this.#pool.give(memory);
      held = false;
    };
    return { ...info, depth, coverage, label, release };
  }
}
