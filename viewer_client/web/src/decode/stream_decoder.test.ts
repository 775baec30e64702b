// SPDX-License-Identifier: Apache-2.0
import { beforeEach, describe, expect, it } from 'vitest';
import type { PictureMessage } from '../transport/picture_message';
import { StreamDecoder, type DecoderFactory, type DecoderLike, type PictureInfo } from './stream_decoder';

interface FakeFrame {
  timestamp: number;
  closed: boolean;
}

class FakeDecoder implements DecoderLike {
  decodeQueueSize = 0;
  closed = false;
  chunks: { type: string; timestamp: number }[] = [];
  readonly init: VideoDecoderInit;
  constructor(init: VideoDecoderInit) {
    this.init = init;
  }
  configure(config: VideoDecoderConfig): void {
    if (config.codec === 'unknown') throw new TypeError('unknown codec');
  }
  decode(chunk: EncodedVideoChunk): void {
    if (this.closed) throw new Error('closed');
    this.chunks.push(chunk);
  }
  close(): void {
    this.closed = true;
  }
  gives(timestamp: number): FakeFrame {
    const frame = { timestamp, closed: false, close: (): void => void (frame.closed = true) };
    this.init.output(frame as unknown as VideoFrame);
    return frame;
  }
}

let made: FakeDecoder[];
let shown: PictureInfo[];
let keys_asked: number;
let troubles: string[];

const factory: DecoderFactory = {
  decoder: (init) => {
    made.push(new FakeDecoder(init));
    return newest();
  },
  chunk: (init) => init as unknown as EncodedVideoChunk,
};

function newest(): FakeDecoder {
  const decoder = made.at(-1);
  if (decoder === undefined) throw new Error('no decoder was made');
  return decoder;
}

function streamOf(codec = 'avc1.64001F'): StreamDecoder {
  const handlers = {
    onFrame: (_frame: VideoFrame, info: PictureInfo) => shown.push(info),
    onNeedKey: () => (keys_asked += 1),
    onTrouble: (reason: string) => troubles.push(reason),
  };
  return new StreamDecoder({ codec }, handlers, factory);
}

function picture(frame: number, key: boolean): PictureMessage {
  return {
    stream: 'color',
    key,
    frame: BigInt(frame),
    capture_us: BigInt(1000 * frame),
    encoded_us: 0n,
    near_m: 0,
    far_m: 0,
    payload: new Uint8Array(1),
  };
}

beforeEach(() => {
  made = [];
  shown = [];
  keys_asked = 0;
  troubles = [];
});

describe('StreamDecoder', () => {
  it('feeds nothing before a key frame, and asks for one', () => {
    const stream = streamOf();
    stream.push(picture(1, false));
    expect([made.length, keys_asked]).toEqual([0, 1]);
    stream.push(picture(2, true));
    stream.push(picture(3, false));
    expect(newest().chunks.map((chunk) => chunk.type)).toEqual(['key', 'delta']);
  });

  it('gives every frame the times of its own message', () => {
    const stream = streamOf();
    for (const frame of [7, 9, 12]) stream.push(picture(frame, frame === 7));
    for (const { timestamp } of newest().chunks) newest().gives(timestamp);
    expect(shown.map((info) => [info.frame, info.capture_us])).toEqual([
      [7n, 7000n],
      [9n, 9000n],
      [12n, 12000n],
    ]);
  });

  it('starts again at the next key frame after an error', () => {
    const stream = streamOf();
    stream.push(picture(1, true));
    newest().init.error(new DOMException('broken bits'));
    expect([troubles, keys_asked, newest().closed]).toEqual([['broken bits'], 1, true]);
    stream.push(picture(2, false));
    expect(made.length).toBe(1);
    stream.push(picture(3, true));
    expect(made.length).toBe(2);
  });

  it('closes what a decoder gives after it was thrown away', () => {
    const stream = streamOf();
    stream.push(picture(1, true));
    const old = newest();
    stream.restart();
    stream.push(picture(2, true));
    expect(old.gives(1).closed).toBe(true);
    old.init.error(new DOMException('late'));
    expect([shown.length, troubles.length, newest().closed]).toEqual([0, 0, false]);
  });

  it('gives up a decoder that has fallen far behind', () => {
    const stream = streamOf();
    stream.push(picture(1, true));
    newest().decodeQueueSize = 100;
    stream.push(picture(2, false));
    expect(troubles).toEqual(['decoder fell behind']);
    expect(newest().closed).toBe(true);
  });

  it('survives a codec that the browser refuses', () => {
    const stream = streamOf('unknown');
    stream.push(picture(1, true));
    expect(troubles).toEqual(['TypeError: unknown codec']);
  });
});
