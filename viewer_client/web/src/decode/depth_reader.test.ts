// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import type { DepthPicture } from './depth_picture';
import { DepthReader } from './depth_reader';

const kInfo = { capture_us: 5n, range: { near_m: 1, far_m: 4 } };

/** A 3 x 3 frame with padded rows, as decoders give them; sample (x, y) of plane p is 100 p + 10 y + x. */
class FakeFrame {
  closed = false;
  readonly format: string;
  readonly codedWidth = 4;
  readonly codedHeight = 4;
  readonly visibleRect = { width: 3, height: 3 };
  constructor(format = 'I420P10') {
    this.format = format;
  }
  allocationSize(): number {
    return 2 * (3 * 5 + 2 * 2 * 3);
  }
  async copyTo(buffer: ArrayBuffer): Promise<PlaneLayout[]> {
    const layouts = [
      { offset: 0, stride: 10 },
      { offset: 30, stride: 6 },
      { offset: 42, stride: 6 },
    ];
    const words = new Uint16Array(buffer).fill(9999);
    layouts.forEach(({ offset, stride }, plane) => {
      const side = plane === 0 ? 3 : 2;
      for (let y = 0; y < side; ++y)
        for (let x = 0; x < side; ++x) words[(offset + y * stride) / 2 + x] = 100 * plane + 10 * y + x;
    });
    return layouts;
  }
  close(): void {
    this.closed = true;
  }
}

function reader(): { reader: DepthReader; pictures: DepthPicture[]; troubles: string[] } {
  const pictures: DepthPicture[] = [];
  const troubles: string[] = [];
  const made = new DepthReader(
    (picture) => pictures.push(picture),
    (reason) => troubles.push(reason),
  );
  return { reader: made, pictures, troubles };
}

function push(to: DepthReader, fake: FakeFrame, frame: bigint): void {
  to.push(fake as unknown as VideoFrame, { ...kInfo, frame });
}

async function settled(): Promise<void> {
  await new Promise((resolve) => setTimeout(resolve, 0));
}

describe('DepthReader', () => {
  it('reads samples through stride and offset, chroma of odd sizes rounded up', async () => {
    const { reader: to, pictures } = reader();
    const frame = new FakeFrame();
    push(to, frame, 1n);
    await settled();
    const picture = pictures[0];
    if (picture === undefined) throw new Error('no picture came');
    const { depth, coverage, label } = picture;
    expect([depth.width, depth.height, coverage.width, label.height]).toEqual([3, 3, 2, 2]);
    expect(depth.samples[2 * depth.stride + 1]).toBe(21);
    expect(coverage.samples[coverage.stride + 1]).toBe(111);
    expect(label.samples[label.stride]).toBe(210);
    expect(frame.closed).toBe(true);
  });

  it('closes every frame and keeps only the newest that waits', async () => {
    const { reader: to, pictures } = reader();
    const frames = [1n, 2n, 3n, 4n].map((number) => {
      const frame = new FakeFrame();
      push(to, frame, number);
      return frame;
    });
    await settled();
    expect(frames.every((frame) => frame.closed)).toBe(true);
    expect(pictures.map((picture) => picture.frame)).toEqual([1n, 4n]);
  });

  it('uses memory again that was released, and no other', async () => {
    const { reader: to, pictures } = reader();
    for (const number of [1n, 2n, 3n]) {
      push(to, new FakeFrame(), number);
      await settled();
      if (number === 2n) pictures[0]?.release();
    }
    const memory = pictures.map((picture) => picture.depth.samples.buffer);
    expect(memory[2]).toBe(memory[0]);
    expect(memory[1]).not.toBe(memory[0]);
  });

  it('says which format it cannot read', async () => {
    const { reader: to, troubles } = reader();
    const frame = new FakeFrame('NV12');
    push(to, frame, 1n);
    await settled();
    expect(troubles).toEqual(['depth decoder gives NV12, not I420P10']);
    expect(frame.closed).toBe(true);
  });
});
