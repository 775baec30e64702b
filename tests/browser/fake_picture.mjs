// SPDX-License-Identifier: Apache-2.0
// Pictures for the page without any camera or encoder: a ray-cast room with boxes in it, as H.264 that is nothing but
// uncompressed macroblocks (I_PCM), 8-bit colour and 10-bit depth. Run as a worker it answers {camera, boxes, count}
// with both streams' access units: the ray caster takes its time, and nothing else shall wait for it.
import { isMainThread, parentPort } from 'node:worker_threads';

/** Bits, most significant first, with the Exp-Golomb codes of H.264. */
class BitWriter {
  bytes = [];
  #used = 8;
  bits(value, count) {
    for (let bit = count - 1; bit >= 0; --bit) {
      if (this.#used === 8) {
        this.bytes.push(0);
        this.#used = 0;
      }
      this.bytes[this.bytes.length - 1] |= ((value >>> bit) & 1) << (7 - this.#used);
      this.#used += 1;
    }
  }
  ue(...values) {
    for (const value of values) {
      const length = 31 - Math.clz32(value + 1);
      this.bits(0, length);
      this.bits(value + 1, length + 1);
    }
  }
  align() {
    this.#used = 8;
  }
}

/** One NAL unit with start code and emulation prevention. */
function nal(header, payload) {
  const out = [0, 0, 0, 1, header];
  let zeros = 0;
  for (const byte of payload) {
    if (zeros === 2 && byte <= 3) {
      out.push(3);
      zeros = 0;
    }
    out.push(byte);
    zeros = byte === 0 ? zeros + 1 : 0;
  }
  return Buffer.from(out);
}

function parameterSets(width, height, bits) {
  const sps = new BitWriter();
  sps.bits(bits === 8 ? 66 : 110, 8);
  sps.bits(bits === 8 ? 0xc0 : 0, 8);
  sps.bits(31, 8);
  sps.ue(0);
  if (bits > 8) {
    sps.ue(1, bits - 8, bits - 8);
    sps.bits(0, 2);
  }
  sps.ue(0, 2, 0);
  sps.bits(0, 1);
  sps.ue(width / 16 - 1, height / 16 - 1);
  // Frames only, direct 8x8, no cropping; VUI: full range, sRGB transfer, BT.601; no reordering.
  sps.bits(0b1101, 4);
  sps.bits(0b001, 3);
  sps.bits(5, 3);
  sps.bits(0b11, 2);
  sps.bits(1, 8);
  sps.bits(13, 8);
  sps.bits(6, 8);
  sps.bits(0b0000011, 7);
  sps.ue(0, 0, 10, 10, 0, 1);
  sps.bits(1, 1);
  const pps = new BitWriter();
  pps.ue(0, 0);
  pps.bits(0, 2);
  pps.ue(0, 0, 0);
  pps.bits(0, 3);
  pps.ue(0, 0, 0);
  pps.bits(0b1001, 4);
  return Buffer.concat([nal(0x67, sps.bytes), nal(0x68, pps.bytes)]);
}

/** A key frame of planes (4:2:0, one number a sample). `count` tells one from the next. */
function accessUnit({ width, height, bits, planes }, count) {
  const slice = new BitWriter();
  slice.ue(0, 7, 0);
  slice.bits(0, 4);
  slice.ue(count % 2);
  slice.bits(0, 2);
  slice.ue(0, 1);
  const [luma, cb, cr] = planes;
  const block = (plane, stride, x0, y0, side) => {
    for (let y = 0; y < side; ++y)
      for (let x = 0; x < side; ++x) {
        const at = (y0 + y) * stride + x0 + x;
        if (bits === 8) slice.bytes.push(plane[at]);
        else if (x % 4 === 0) {
          // Four samples of ten bits are five bytes.
          const [a, b, c, d] = [plane[at], plane[at + 1], plane[at + 2], plane[at + 3]];
          slice.bytes.push(
            a >> 2,
            ((a & 3) << 6) | (b >> 4),
            ((b & 15) << 4) | (c >> 6),
            ((c & 63) << 2) | (d >> 8),
            d & 255,
          );
        }
      }
  };
  for (let y = 0; y < height; y += 16)
    for (let x = 0; x < width; x += 16) {
      slice.ue(25);
      slice.align();
      block(luma, width, x, y, 16);
      block(cb, width / 2, x / 2, y / 2, 8);
      block(cr, width / 2, x / 2, y / 2, 8);
    }
  slice.align();
  slice.bits(1, 1);
  return Buffer.concat([parameterSets(width, height, bits), nal(0x65, slice.bytes)]);
}

export const kRoom = { x: [0, 6], y: [-3, 3], z: [0, 2.8] };
export const kRange = { near_m: 1, far_m: 8 };

/** Where a ray enters a box and which axis' face it meets there; leaves it, if `inside`. */
function meetBox(from, along, low, high, inside) {
  let enter = -Infinity;
  let leave = Infinity;
  let enter_axis = 0;
  let leave_axis = 0;
  for (let axis = 0; axis < 3; ++axis) {
    const a = (low[axis] - from[axis]) / along[axis];
    const b = (high[axis] - from[axis]) / along[axis];
    const first = Math.min(a, b);
    const last = Math.max(a, b);
    if (first > enter) {
      enter = first;
      enter_axis = axis;
    }
    if (last < leave) {
      leave = last;
      leave_axis = axis;
    }
  }
  if (inside) return { t: leave, axis: leave_axis };
  return enter < leave && enter > 0 ? { t: enter, axis: enter_axis } : null;
}

function roomColor(point, axis) {
  const checker = (Math.floor(point[0] * 2) + Math.floor(point[1] * 2)) & 1;
  if (axis === 2) return point[2] < 1 ? (checker ? [96, 84, 72] : [110, 98, 84]) : [150, 152, 155];
  const shade = 0.75 + 0.25 * (point[2] / 2.8);
  return axis === 0 ? [118 * shade, 132 * shade, 146 * shade] : [134 * shade, 126 * shade, 118 * shade];
}

/** One pixel: colour, z along the optical axis, whether it is the actor. `boxes` are upright, in the world. */
function cast(camera, boxes, u, v) {
  const { T, fx, fy, cx, cy } = camera;
  const x = (u - cx) / fx;
  const y = (v - cy) / fy;
  const along = [T[0] * x + T[1] * y + T[2], T[4] * x + T[5] * y + T[6], T[8] * x + T[9] * y + T[10]];
  const from = [T[3], T[7], T[11]];
  const low = [kRoom.x[0] - 4, kRoom.y[0], kRoom.z[0]];
  const wall = meetBox(from, along, low, [kRoom.x[1], kRoom.y[1], kRoom.z[1]], true);
  let best = { ...wall, color: null, actor: false };
  for (const { base, half, height, turn_rad, color, actor } of boxes) {
    const c = Math.cos(turn_rad);
    const s = Math.sin(turn_rad);
    const px = from[0] - base[0];
    const py = from[1] - base[1];
    const at = [c * px + s * py, c * py - s * px, from[2] - base[2]];
    const way = [c * along[0] + s * along[1], c * along[1] - s * along[0], along[2]];
    const hit = meetBox(at, way, [-half, -half, 0], [half, half, height], false);
    if (hit !== null && hit.t < best.t) best = { ...hit, color, actor };
  }
  const point = from.map((value, axis) => value + best.t * along[axis]);
  const shade = [0.85, 0.7, 1][best.axis];
  const rgb = best.color === null ? roomColor(point, best.axis) : best.color.map((part) => part * shade);
  return { rgb, z_m: best.t, actor: best.actor };
}

/** Colour and depth of the scene from a camera. */
function render(camera, boxes) {
  const { width, height } = camera;
  const half = (width / 2) * (height / 2);
  const color = [new Uint8Array(width * height), new Uint8Array(half), new Uint8Array(half)];
  const depth = [new Uint16Array(width * height), new Uint16Array(half), new Uint16Array(half).fill(128)];
  for (let y = 0, to = 0; y < height; ++y)
    for (let x = 0; x < width; ++x, ++to) {
      const { rgb, z_m, actor } = cast(camera, boxes, x, y);
      const [r, g, b] = rgb;
      color[0][to] = 0.299 * r + 0.587 * g + 0.114 * b;
      const { near_m, far_m } = kRange;
      const inverse = (1 / z_m - 1 / far_m) / (1 / near_m - 1 / far_m);
      depth[0][to] = 1 + Math.round(1022 * Math.min(1, Math.max(0, inverse)));
      if (x % 2 || y % 2) continue;
      const at = (y / 2) * (width / 2) + x / 2;
      color[1][at] = 128 - 0.1687 * r - 0.3313 * g + 0.5 * b;
      color[2][at] = 128 + 0.5 * r - 0.4187 * g - 0.0813 * b;
      depth[1][at] = actor ? 1020 : 0;
    }
  return {
    color: { width, height, bits: 8, planes: color },
    depth: { width, height, bits: 10, planes: depth },
  };
}

if (!isMainThread && parentPort !== null)
  parentPort.on('message', ({ camera, boxes, count }) => {
    const { color, depth } = render(camera, boxes);
    parentPort.postMessage({ color: accessUnit(color, count), depth: accessUnit(depth, count) });
  });
