// SPDX-License-Identifier: Apache-2.0
import type { PictureMessage } from '../transport/picture_message';

/** The part of VideoDecoder that is used, so that tests can stand in for it. */
export interface DecoderLike {
  readonly decodeQueueSize: number;
  configure(config: VideoDecoderConfig): void;
  decode(chunk: EncodedVideoChunk): void;
  close(): void;
}

export interface DecoderFactory {
  decoder(init: VideoDecoderInit): DecoderLike;
  chunk(init: EncodedVideoChunkInit): EncodedVideoChunk;
}

export const kWebCodecs: DecoderFactory = {
  decoder: (init) => new VideoDecoder(init),
  chunk: (init) => new EncodedVideoChunk(init),
};

export type PictureInfo = Omit<PictureMessage, 'payload'>;

export interface StreamHandlers {
  /** The receiver owns the frame and closes it. */
  onFrame(frame: VideoFrame, info: PictureInfo): void;
  /** Nothing can be decoded before a key frame comes. Called for every picture that is passed over. */
  onNeedKey(): void;
  /** The decoder was thrown away; it starts again at the next key frame. */
  onTrouble(reason: string): void;
}

// A decoder takes up to a second to start and then catches up at once; one that is further behind never will.
const kMaxQueued = 45;
// Decoders give pictures out of nothing only after errors; what waits longer than this never comes.
const kMaxPending = 64;

/** One WebCodecs decoder of one stream: begins at a key frame, begins again after any error. */
export class StreamDecoder {
  readonly #config: VideoDecoderConfig;
  readonly #handlers: StreamHandlers;
  readonly #factory: DecoderFactory;
  #decoder: DecoderLike | null = null;
  #pending = new Map<number, PictureInfo>();
  #sequence = 0;

  constructor(config: VideoDecoderConfig, handlers: StreamHandlers, factory: DecoderFactory = kWebCodecs) {
    this.#config = config;
    this.#handlers = handlers;
    this.#factory = factory;
  }

  get codec(): string {
    return this.#config.codec;
  }

  push(picture: PictureMessage): void {
    if (this.#decoder !== null && this.#decoder.decodeQueueSize > kMaxQueued)
      this.#trouble('decoder fell behind');
    if (this.#decoder === null) {
      if (!picture.key) return this.#handlers.onNeedKey();
      this.#decoder = this.#open();
      if (this.#decoder === null) return;
    }
    const { payload, ...info } = picture;
    const timestamp = ++this.#sequence;
    this.#pending.set(timestamp, info);
    if (this.#pending.size > kMaxPending) this.#pending.delete(timestamp - kMaxPending);
    try {
      this.#decoder.decode(
        this.#factory.chunk({ type: picture.key ? 'key' : 'delta', timestamp, data: payload }),
      );
    } catch (error) {
      this.#trouble(String(error));
    }
  }

  /** Forgets what came so far; the next key frame starts afresh. */
  restart(): void {
    const decoder = this.#decoder;
    this.#decoder = null;
    this.#pending.clear();
    try {
      decoder?.close();
    } catch {
      // A decoder that failed has closed itself already.
    }
  }

  close(): void {
    this.restart();
  }

  #open(): DecoderLike | null {
    // An error of a decoder that was thrown away before must not hit its successor.
    const decoder: DecoderLike = this.#factory.decoder({
      output: (frame) => (this.#decoder === decoder ? this.#output(frame) : frame.close()),
      error: (error) => {
        if (this.#decoder === decoder) this.#trouble(error.message);
      },
    });
    try {
      decoder.configure(this.#config);
      return decoder;
    } catch (error) {
      this.#trouble(String(error));
      return null;
    }
  }

  #output(frame: VideoFrame): void {
    const info = this.#pending.get(frame.timestamp);
    this.#pending.delete(frame.timestamp);
    if (info === undefined) return frame.close();
    this.#handlers.onFrame(frame, info);
  }

  #trouble(reason: string): void {
    this.restart();
    this.#handlers.onTrouble(reason);
    this.#handlers.onNeedKey();
  }
}
