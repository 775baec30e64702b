// SPDX-License-Identifier: Apache-2.0
// A show without rig and server, to see and to check the page by: speaks SPEC 4.1 to 4.5, everything in memory.
//
//   node fake_server.mjs --page DIR [--port 8090] [--login] [--no-pictures]
//
// --login asks for the tokens `kDirectorToken` and `kViewerToken` below. Loopback only; nothing here is meant to last.
import { createHash, randomBytes } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { Worker } from 'node:worker_threads';
import { actorMesh, boxMesh, meshMessage, pictureMessage, roomMesh } from './fake_mesh.mjs';
import { kRange } from './fake_picture.mjs';
import { FakeScene } from './fake_scene.mjs';

export const kDirectorToken = 'director'.padEnd(43, '_');
export const kViewerToken = 'viewer'.padEnd(43, '_');
const kUsers = { [kDirectorToken]: ['anna', 'director'], [kViewerToken]: ['ben', 'viewer'] };
const kTypes = {
  '.html': 'text/html; charset=utf-8',
  '.js': 'text/javascript; charset=utf-8',
  '.css': 'text/css; charset=utf-8',
  '.wasm': 'application/wasm',
};
// As server/delivery/http_connection.cc sends it.
const kPolicy =
  "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' data:; connect-src 'self'; worker-src 'self'; style-src 'self'";
const kSlope_rad = 0.14;
const [kCos, kSin] = [Math.cos(kSlope_rad), Math.sin(kSlope_rad)];
// 1.6 m above the floor, looking along +x and a little down.
const kCamera = {
  width: 384,
  height: 288,
  fx: 330,
  fy: 330,
  cx: 191.5,
  cy: 143.5,
  T: [0, -kSin, kCos, -0.6, -1, 0, 0, 0, 0, -kCos, -kSin, 1.6],
};
const kPicturesEvery_ms = 400;
const kMeshesEvery_ms = 160;

/** One message as a WebSocket frame from a server. */
function frame(opcode, payload) {
  const bytes = Buffer.from(payload);
  const long = bytes.length > 65535 ? 10 : bytes.length > 125 ? 4 : 2;
  const head = Buffer.alloc(long);
  head[0] = 0x80 | opcode;
  head[1] = long === 2 ? bytes.length : long === 4 ? 126 : 127;
  if (long === 4) head.writeUInt16BE(bytes.length, 2);
  if (long === 10) head.writeBigUInt64BE(BigInt(bytes.length), 2);
  return Buffer.concat([head, bytes]);
}

/** Takes whole frames of a browser off the front of `buffer`. Browsers mask, and do not split what is short. */
function* frames(buffer) {
  while (buffer.length >= 6) {
    const short = buffer[1] & 127;
    const at = short === 126 ? 4 : 2;
    const length = short === 126 ? buffer.readUInt16BE(2) : short;
    if (buffer.length < at + 4 + length) break;
    const mask = buffer.subarray(at, at + 4);
    const payload = buffer.subarray(at + 4, at + 4 + length).map((byte, index) => byte ^ mask[index & 3]);
    const opcode = buffer[0] & 15;
    buffer = buffer.subarray(at + 4 + length);
    yield { opcode, payload, rest: buffer };
  }
}

class FakeViewer {
  streams = new Set();
  user = ['', 'director'];
  #buffer = Buffer.alloc(0);

  constructor(socket, show) {
    this.socket = socket;
    this.show = show;
    socket.on('data', (bytes) => this.#read(bytes));
    socket.on('error', () => socket.destroy());
    socket.on('close', () => show.viewers.delete(this));
    if (!show.login) this.welcome();
  }

  welcome() {
    this.streams = new Set(['color', 'depth']);
    this.show.viewers.add(this);
    this.say(this.show.hello(this.user[1]));
    this.say(this.show.scene.message());
  }

  say(message) {
    this.socket.write(frame(1, JSON.stringify(message)));
  }

  give(bytes) {
    // A stalled page is spared: what it did not take is not queued for it.
    if (this.socket.writableLength < 4e6) this.socket.write(frame(2, bytes));
  }

  #read(bytes) {
    this.#buffer = Buffer.concat([this.#buffer, bytes]);
    for (const { opcode, payload, rest } of frames(this.#buffer)) {
      this.#buffer = Buffer.from(rest);
      if (opcode === 8) return this.socket.end();
      if (opcode === 1) this.#hear(JSON.parse(payload.toString()));
    }
  }

  #hear(message) {
    this.show.heard.push(message);
    if (message.type === 'ticket') {
      const user = this.show.tickets.get(message.ticket);
      this.show.tickets.delete(message.ticket);
      if (user === undefined) return this.socket.end();
      this.user = user;
      return this.welcome();
    }
    if (message.type === 'ping')
      this.say({ type: 'pong', viewer_us: message.viewer_us, server_us: this.show.now_us });
    if (message.type === 'subscribe') {
      this.streams = new Set(message.streams);
      if (this.streams.has('mesh')) this.show.giveMeshes(this);
    }
    if (message.type !== 'edit') return;
    const refusal =
      this.user[1] === 'director'
        ? this.show.edit(message, this.user[0])
        : 'Only a director may change the scene.';
    if (refusal !== null) this.say({ type: 'refused', id: message.id, reason: refusal });
  }
}

export class FakeShow {
  viewers = new Set();
  tickets = new Map();
  /** Everything that pages said, for tests to look at. */
  heard = [];
  state = 'live';
  scene = new FakeScene(kCamera);
  #frame = 0;
  #timers = [];
  #painter = new Worker(new URL('./fake_picture.mjs', import.meta.url));
  #painting = false;
  #painted_us = 0;
  #started_ms = Date.now();

  constructor({ page, login = false, pictures = true }) {
    this.login = login;
    this.pictures = pictures;
    this.server = createServer((request, response) => this.#answer(page, request, response));
    this.#painter.on('message', (pictures) => this.#givePictures(pictures));
    this.server.on('upgrade', (request, socket) => this.#upgrade(request, socket));
  }

  listen(port) {
    return new Promise((resolve) => {
      this.server.listen(port, '127.0.0.1', () => {
        this.#timers = [
          setInterval(() => this.#paint(), kPicturesEvery_ms),
          setInterval(() => this.#giveActor(), kMeshesEvery_ms),
          setInterval(() => this.#tell(this.#stats()), 500),
        ];
        resolve(this.server.address().port);
      });
    });
  }

  close() {
    this.#timers.forEach(clearInterval);
    for (const viewer of this.viewers) viewer.socket.destroy();
    void this.#painter.terminate();
    this.server.close();
    this.server.closeAllConnections();
  }

  get now_us() {
    return 1000 * (Date.now() - this.#started_ms);
  }

  hello(role) {
    const { width, height, fx, fy, cx, cy } = kCamera;
    const stream = (name, codec) => ({ stream: name, codec, width, height });
    const streams = this.pictures ? [stream('color', 'avc1.42C01F'), stream('depth', 'avc1.6E001F')] : [];
    return {
      type: 'hello',
      protocol: 1,
      name: 'studio-1',
      server_us: this.now_us,
      role,
      streams,
      camera: { width, height, fx, fy, cx, cy },
    };
  }

  /** Null when it was done; then everyone is told. */
  edit(edit, by) {
    const known = new Set(this.scene.state.objects.map(({ id }) => id));
    const refusal = this.scene.edit(edit, by);
    if (refusal !== null) return refusal;
    this.#tell(this.scene.message());
    for (const object of this.scene.state.objects)
      if (!known.has(object.id)) for (const viewer of this.viewers) this.#giveObject(viewer, object);
    return null;
  }

  giveMeshes(viewer) {
    viewer.give(meshMessage(4, 0, roomMesh(), this.#frame, this.now_us));
    for (const object of this.scene.state.objects) this.#giveObject(viewer, object);
  }

  #giveObject(viewer, { id, file }) {
    if (!viewer.streams.has('mesh')) return;
    viewer.give(meshMessage(5, id, boxMesh(this.scene.model(file)), this.#frame, this.now_us));
  }

  /** The actor walks to and fro. */
  get #actor() {
    return [3.2, 0.9 * Math.sin(this.now_us / 3e6)];
  }

  #giveActor() {
    const takers = [...this.viewers].filter(({ streams }) => streams.has('mesh'));
    if (takers.length === 0) return;
    const message = meshMessage(3, 0, actorMesh(this.#actor, kCamera.T), this.#frame, this.now_us);
    for (const viewer of takers) viewer.give(message);
  }

  #paint() {
    if (!this.pictures || this.#painting || this.state !== 'live' || this.viewers.size === 0) return;
    this.#painting = true;
    this.#frame += 1;
    const [x, y] = this.#actor;
    const actor = {
      base: [x, y, 0],
      half: 0.2,
      height: 1.75,
      turn_rad: 0,
      color: [150, 72, 66],
      actor: true,
    };
    this.#painted_us = this.now_us;
    this.#painter.postMessage({ camera: kCamera, boxes: [...this.scene.boxes, actor], count: this.#frame });
  }

  #givePictures({ color, depth }) {
    this.#painting = false;
    const messages = {
      color: pictureMessage(1, this.#frame, this.#painted_us, Buffer.from(color)),
      depth: pictureMessage(2, this.#frame, this.#painted_us, Buffer.from(depth), kRange),
    };
    for (const viewer of this.viewers)
      for (const [stream, message] of Object.entries(messages))
        if (viewer.streams.has(stream)) viewer.give(message);
  }

  #tell(message) {
    for (const viewer of this.viewers) viewer.say(message);
  }

  #stats() {
    const stages = {
      receive: [2, 2.1],
      warp_depth: [3, 2.2],
      key: [6, 5.1],
      render_cg: [8, 5.9],
      z_key: [6, 4.2],
      encode: [9, 7.8],
    };
    const agent = { age_s: 0.2, color_fps: 30, depth_fps: 12.5, drops: 0, queue: 0, encode_ms: 2.1 };
    return {
      type: 'stats',
      server_us: this.now_us,
      state: this.state,
      message: '',
      fps: 30,
      frames: this.#frame,
      width: kCamera.width,
      height: kCamera.height,
      latency_ms: { p50: 31, p99: 44 },
      bitrate_bps: 4.1e6,
      viewers: this.viewers.size,
      drops: { late: 3, lost: 1 },
      stages: Object.entries(stages).map(([name, [budget_ms, wall_ms]]) => ({
        name,
        budget_ms,
        wall_ms,
        cpu_ms: wall_ms,
      })),
      agents:
        this.state === 'no_agent'
          ? []
          : [
              {
                ...agent,
                epoch: '0123456789abcdef',
                name: 'head-1',
                lost: 1,
                repaired: 212,
                slice_loss: 0.004,
                delay_ms: 1.2,
                recording: true,
              },
            ],
      depth_age_s: 0.04,
      recording: { active: true, seconds: this.now_us / 1e6, dropped: 0 },
    };
  }

  #answer(page, request, response) {
    const path = request.url.split('?')[0];
    const end = (status, type, body) => {
      response.writeHead(status, { 'Content-Type': type, 'Content-Security-Policy': kPolicy });
      response.end(body);
    };
    if (path === '/healthz')
      return end(200, 'application/json', JSON.stringify({ status: 'ok', login: this.login }));
    if (path === '/login' && request.method === 'POST') {
      const user = kUsers[(request.headers.authorization ?? '').replace('Bearer ', '')];
      if (user === undefined) return end(401, 'text/plain', 'No such token.\n');
      const ticket = randomBytes(32).toString('base64url');
      this.tickets.set(ticket, user);
      return end(200, 'application/json', JSON.stringify({ ticket, name: user[0], role: user[1] }));
    }
    try {
      const file = join(page, normalize(path === '/' ? '/index.html' : path));
      end(200, kTypes[extname(file)] ?? 'application/octet-stream', readFileSync(file));
    } catch {
      end(404, 'text/plain', 'Nothing is here.\n');
    }
  }

  #upgrade(request, socket) {
    const accept = createHash('sha1')
      .update(`${request.headers['sec-websocket-key']}258EAFA5-E914-47DA-95CA-C5AB0DC85B11`)
      .digest('base64');
    socket.write(
      `HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: ${accept}\r\n\r\n`,
    );
    new FakeViewer(socket, this);
  }
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const { values } = parseArgs({
    options: {
      page: { type: 'string' },
      port: { type: 'string', default: '8090' },
      login: { type: 'boolean' },
      'no-pictures': { type: 'boolean' },
    },
  });
  if (values.page === undefined) {
    console.error('fake_server.mjs: give --page DIR, the built page');
    process.exit(2);
  }
  const show = new FakeShow({ page: values.page, login: values.login, pictures: !values['no-pictures'] });
  console.log(`http://localhost:${await show.listen(Number(values.port))}/`);
}
