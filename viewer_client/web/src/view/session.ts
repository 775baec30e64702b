// SPDX-License-Identifier: Apache-2.0
import { DepthReader } from '../decode/depth_reader';
import { StreamDecoder, type PictureInfo } from '../decode/stream_decoder';
import { ClockOffset } from '../transport/clock_offset';
import {
  kProtocol,
  type ControlMessage,
  type Hello,
  type StreamOffer,
  type Subscription,
} from '../transport/control_message';
import type { LightMessage } from '../transport/light_message';
import type { MeshMessage } from '../transport/mesh_message';
import { kStreamNames, type PictureMessage, type StreamName } from '../transport/picture_message';
import { WatchSocket, type Link } from '../transport/watch_socket';
import type { DepthPicture } from '../decode/depth_picture';
import type { FromWorker, PictureSize, Shown, Status, ToWorker } from './messages';
import type { ToRoomFromSession } from './room_messages';
import { MedianMeter, RateMeter } from './meters';
import { Screens } from './screens';
import { wantedStreams } from './wanted_streams';

// The server serves two key frames a second for all viewers together; asking oftener gains nothing.
const kKeyframeEvery_ms = 500;
// A few exchanges at once find a small round trip early; then the clock's drift is followed.
const kFirstPings = 6;
const kFirstPingEvery_ms = 150;
const kPingEvery_ms = 2000;

/** Milliseconds since 1970, finer than Date and never set back while the page lives. */
function clockNow_ms(): number {
  return performance.timeOrigin + performance.now();
}

/** Everything between the socket and the canvases, in the worker: one connection, two decoders, three panes. */
export class Session {
  readonly #post: (message: FromWorker) => void;
  readonly #screens: Screens;
  readonly #socket: WatchSocket;
  readonly #depth_reader: DepthReader;
  readonly #clock = new ClockOffset();
  readonly #decoders = new Map<StreamName, StreamDecoder>();
  readonly #undecodable: Partial<Record<StreamName, string>> = {};
  readonly #color_rate = new RateMeter();
  readonly #byte_rate = new RateMeter();
  readonly #latency = new MedianMeter();
  #link: Link = { phase: 'connecting', attempt: 0 };
  #wanted: Subscription[];
  #meshes: MessagePort | null = null;
  /** The 3D pane still shows what an earlier connection sent. */
  #meshes_are_old = false;
  #size: PictureSize | null = null;
  #next_color: { frame: VideoFrame; info: PictureInfo } | null = null;
  #color_frames = 0;
  #depth_frames = 0;
  #last_frame: bigint | null = null;
  #color_at_ms: number | null = null;
  #depth_at_ms: number | null = null;
  #matte_at_ms: number | null = null;
  #matte_pictures = 0;
  #asked_key_ms = -Infinity;
  #pings = 0;
  #ping_timer: ReturnType<typeof setTimeout> | undefined;
  #light_is_decoded = false;
  #restarts = 0;
  #refused = 0;
  #last_trouble = '';

  constructor(start: Extract<ToWorker, { type: 'start' }>, post: (message: FromWorker) => void) {
    this.#post = post;
    this.#wanted = wantedStreams(start.shown);
    this.#screens = new Screens(start.canvases, start.shown);
    this.#depth_reader = new DepthReader(
      (picture) => this.#showDepth(picture),
      (reason) => this.#trouble(reason),
    );
    this.#socket = new WatchSocket(start.url, start.token, {
      onLink: (link) => this.#linkChanged(link),
      onPicture: (picture, bytes) => this.#picture(picture, bytes),
      onMesh: (mesh, bytes) => this.#mesh(mesh, bytes),
      onLight: (light, bytes) => void this.#light(light, bytes),
      onControl: (message) => this.#control(message),
      onRefused: (reason) => {
        this.#refused += 1;
        this.#last_trouble = reason;
      },
    });
  }

  receive(message: Exclude<ToWorker, { type: 'start' }>): void {
    if (message.type === 'show') this.#show(message.shown);
    if (message.type === 'freeze') this.#screens.freeze(message.frozen);
    if (message.type === 'probe') this.#screens.probe(message.point);
    if (message.type === 'meshes') this.#meshes = message.port;
    if (message.type === 'login') this.#socket.logIn(message.token);
    if (message.type === 'edit') this.#socket.send(message.edit);
    else this.#postReading();
  }

  close(): void {
    clearTimeout(this.#ping_timer);
    this.#socket.close();
    this.#closeDecoders();
    this.#depth_reader.close();
  }

  get status(): Status {
    const now_ms = clockNow_ms();
    const age = (at_ms: number | null): number | null => (at_ms === null ? null : (now_ms - at_ms) / 1000);
    const round_trip_us = this.#clock.round_trip_us;
    return {
      link: this.#link,
      user: this.#socket.name,
      color_frames: this.#color_frames,
      depth_frames: this.#depth_frames,
      last_frame: this.#last_frame?.toString() ?? null,
      size: this.#size,
      color_age_s: age(this.#color_at_ms),
      depth_age_s: age(this.#depth_at_ms),
      matte_age_s: age(this.#matte_at_ms),
      fps: this.#color_rate.perSecond(now_ms),
      latency_ms: this.#latency.median,
      megabits_per_s: (8 * this.#byte_rate.perSecond(now_ms)) / 1e6,
      round_trip_ms: round_trip_us === null ? null : round_trip_us / 1000,
      range: this.#screens.range,
      frozen_frame: this.#screens.frozen_frame,
      wanted: this.#wanted,
      undecodable: this.#undecodable,
      restarts: this.#restarts,
      refused: this.#refused,
      last_trouble: this.#last_trouble,
    };
  }

  #linkChanged(link: Link): void {
    this.#link = link;
    if (link.phase === 'open') return;
    this.#meshes_are_old = true;
    clearTimeout(this.#ping_timer);
    this.#closeDecoders();
    this.#clock.reset();
    this.#latency.reset();
  }

  #control(message: ControlMessage): void {
    if (message.type === 'hello') this.#hello(message.hello);
    if (message.type === 'stats' || message.type === 'scene' || message.type === 'refused')
      this.#post(message);
    if (message.type === 'pong') {
      this.#clock.addExchange(message.pong.viewer_us, message.pong.server_us, 1000 * clockNow_ms());
    }
  }

  #hello(hello: Hello): void {
    this.#post({ type: 'hello', hello });
    if (hello.protocol !== kProtocol) return;
    for (const offer of hello.streams) this.#offer(offer);
    // A new viewer gets both pictures unasked, and keeps what it has asked for.
    if (this.#wanted.join() !== kStreamNames.join()) this.#subscribe();
    this.#pings = 0;
    clearTimeout(this.#ping_timer);
    this.#ping();
  }

  /** Viewers' clocks are read in microseconds, so that a pong gives the very number back. */
  #ping(): void {
    this.#socket.send({ type: 'ping', viewer_us: Math.round(1000 * clockNow_ms()) });
    this.#pings += 1;
    const wait_ms = this.#pings < kFirstPings ? kFirstPingEvery_ms : kPingEvery_ms;
    this.#ping_timer = setTimeout(() => this.#ping(), wait_ms);
  }

  #offer(offer: StreamOffer): void {
    const { stream, codec } = offer;
    if (this.#decoders.get(stream)?.codec === codec) return;
    this.#decoders.get(stream)?.close();
    delete this.#undecodable[stream];
    // Depth is read back sample by sample: only decoding in software promises the planes as they were encoded.
    const config: VideoDecoderConfig = {
      codec,
      optimizeForLatency: true,
      hardwareAcceleration: stream === 'depth' ? 'prefer-software' : 'no-preference',
    };
    const decoder = new StreamDecoder(config, {
      onFrame: (frame, info) => this.#decoded(stream, frame, info),
      onNeedKey: () => this.#askKey(),
      onTrouble: (reason) => this.#trouble(`${stream}: ${reason}`),
    });
    this.#decoders.set(stream, decoder);
    // Decoding has begun meanwhile: the first picture does not wait for the answer.
    void VideoDecoder.isConfigSupported(config).then(
      ({ supported }) => (supported === true ? undefined : this.#giveUp(stream, decoder)),
      () => this.#giveUp(stream, decoder),
    );
  }

  #giveUp(stream: StreamName, decoder: StreamDecoder): void {
    if (this.#decoders.get(stream) !== decoder) return;
    this.#undecodable[stream] = decoder.codec;
    this.#decoders.delete(stream);
    decoder.close();
  }

  #picture(picture: PictureMessage, message_bytes: number): void {
    this.#byte_rate.add(clockNow_ms(), message_bytes);
    if (this.#wanted.includes(picture.stream)) this.#decoders.get(picture.stream)?.push(picture);
  }

  /** Hands the message's memory on: the payload is a view into it. */
  #mesh(message: MeshMessage, message_bytes: number): void {
    this.#byte_rate.add(clockNow_ms(), message_bytes);
    if (this.#meshes === null || !this.#wanted.includes('mesh')) return;
    if (this.#meshes_are_old) this.#toRoom({ type: 'forget' });
    this.#meshes_are_old = false;
    const { stream, id, T_scene_color, mesh, texture } = message;
    const parcel = { stream, id, T_scene_color, mesh, texture };
    this.#toRoom({ type: 'mesh', parcel }, [mesh.buffer as ArrayBuffer]);
  }

  /** One at a time: what comes while another is decoded is left out. */
  async #light({ jpeg }: LightMessage, message_bytes: number): Promise<void> {
    this.#byte_rate.add(clockNow_ms(), message_bytes);
    if (this.#light_is_decoded || !this.#wanted.includes('light')) return;
    this.#light_is_decoded = true;
    try {
      const picture = await createImageBitmap(new Blob([jpeg], { type: 'image/jpeg' }));
      this.#screens.drawLight(picture);
      picture.close();
      this.#watchMatte();
    } catch {
      this.#trouble('light: not a picture');
    } finally {
      this.#light_is_decoded = false;
    }
  }

  #toRoom(message: ToRoomFromSession, transfer: Transferable[] = []): void {
    this.#meshes?.postMessage(message, transfer);
  }

  #decoded(stream: StreamName, frame: VideoFrame, info: PictureInfo): void {
    if (stream === 'depth') {
      const range = { near_m: info.near_m, far_m: info.far_m };
      return this.#depth_reader.push(frame, { frame: info.frame, capture_us: info.capture_us, range });
    }
    // Drawn in a task of its own: of pictures that came out in a burst only the newest is.
    this.#next_color?.frame.close();
    if (this.#next_color === null) setTimeout(() => this.#drawColor(), 0);
    this.#next_color = { frame, info };
  }

  #drawColor(): void {
    if (this.#next_color === null) return;
    const { frame, info } = this.#next_color;
    this.#next_color = null;
    this.#size = { width: frame.displayWidth, height: frame.displayHeight };
    try {
      this.#screens.drawColor(frame, info.frame);
    } finally {
      frame.close();
    }
    const now_ms = clockNow_ms();
    this.#color_frames += 1;
    this.#last_frame = info.frame;
    this.#color_at_ms = now_ms;
    this.#color_rate.add(now_ms);
    this.#watchMatte();
    const offset_us = this.#clock.offset_us;
    if (offset_us !== null) this.#latency.add((1000 * now_ms + offset_us - Number(info.capture_us)) / 1000);
  }

  #showDepth(picture: DepthPicture): void {
    this.#screens.drawDepth(picture);
    this.#depth_frames += 1;
    this.#depth_at_ms = clockNow_ms();
    this.#watchMatte();
    this.#size ??= { width: picture.depth.width, height: picture.depth.height };
    this.#postReading();
  }

  #watchMatte(): void {
    if (this.#screens.matte_pictures === this.#matte_pictures) return;
    this.#matte_pictures = this.#screens.matte_pictures;
    this.#matte_at_ms = clockNow_ms();
  }

  #show(shown: Shown): void {
    const wanted = wantedStreams(shown);
    this.#screens.show(shown);
    if (wanted.join() === this.#wanted.join()) return;
    for (const stream of kStreamNames) {
      if (wanted.includes(stream) === this.#wanted.includes(stream)) continue;
      // What was left out between then and now cannot be caught up: a new start at a key frame.
      this.#decoders.get(stream)?.restart();
      if (stream === 'color') this.#color_at_ms = null;
      else this.#depth_at_ms = null;
    }
    const pictures = (of: readonly Subscription[]): StreamName[] =>
      kStreamNames.filter((name) => of.includes(name));
    const [before, after] = [pictures(this.#wanted), pictures(wanted)];
    this.#wanted = wanted;
    this.#subscribe();
    if (before.join() === after.join()) return;
    this.#matte_at_ms = null;
    if (!wanted.includes('depth')) this.#screens.forgetDepth();
    this.#color_rate.reset();
    this.#latency.reset();
    if (after.some((stream) => !before.includes(stream))) this.#askKey();
  }

  #subscribe(): void {
    this.#socket.send({ type: 'subscribe', streams: this.#wanted });
  }

  #askKey(): void {
    const now_ms = clockNow_ms();
    if (now_ms - this.#asked_key_ms < kKeyframeEvery_ms) return;
    if (this.#socket.send({ type: 'keyframe' })) this.#asked_key_ms = now_ms;
  }

  #postReading(): void {
    this.#post({ type: 'probe', reading: this.#screens.reading });
  }

  #trouble(reason: string): void {
    this.#restarts += 1;
    this.#last_trouble = reason;
  }

  #closeDecoders(): void {
    for (const decoder of this.#decoders.values()) decoder.close();
    this.#decoders.clear();
    this.#next_color?.frame.close();
    this.#next_color = null;
    this.#screens.forgetDepth();
  }
}
