// SPDX-License-Identifier: Apache-2.0
import { metresOfCode } from '../decode/depth_code';
import { labelOf, type DepthPicture, type Label, type Plane } from '../decode/depth_picture';

/** A place in a picture, independent of its size: 0..1 from its left and upper edge. */
export interface ProbePoint {
  u: number;
  v: number;
}

export interface ProbeReading {
  /** Pixel of the depth picture. */
  x: number;
  y: number;
  frame: string;
  /** Of exactly this pixel; null where nothing is known. */
  z_m: number | null;
  /** Median of the known ones of 3x3; null when none is. */
  median_m: number | null;
  /** Coverage of the actor, 0..1. */
  coverage: number;
  label: Label;
}

function at(plane: Plane, x: number, y: number): number {
  return plane.samples[y * plane.stride + x] ?? 0;
}

function pixelOf(position: number, size: number): number {
  return Math.min(size - 1, Math.max(0, Math.floor(position * size)));
}

function medianCode(depth: Plane, x: number, y: number): number {
  const known: number[] = [];
  for (let row = Math.max(0, y - 1); row <= Math.min(depth.height - 1, y + 1); ++row) {
    for (let column = Math.max(0, x - 1); column <= Math.min(depth.width - 1, x + 1); ++column) {
      const code = at(depth, column, row);
      if (code > 0) known.push(code);
    }
  }
  // Depth falls as codes rise, so their order is the order of depths; of an even number the nearer counts.
  return known.sort((a, b) => a - b)[known.length >> 1] ?? 0;
}

export function readDepth(picture: DepthPicture, point: ProbePoint): ProbeReading {
  const { depth, coverage, label, range } = picture;
  const x = pixelOf(point.u, depth.width);
  const y = pixelOf(point.v, depth.height);
  const code = at(depth, x, y);
  const median = medianCode(depth, x, y);
  const alpha4 = at(coverage, x >> 1, y >> 1);
  return {
    x,
    y,
    frame: picture.frame.toString(),
    z_m: code > 0 ? metresOfCode(code, range) : null,
    median_m: median > 0 ? metresOfCode(median, range) : null,
    coverage: Math.min(1, alpha4 / 1020),
    label: labelOf(alpha4, at(label, x >> 1, y >> 1)),
  };
}
