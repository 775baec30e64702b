// SPDX-License-Identifier: Apache-2.0
import type { DepthRange } from './depth_code';

/** One plane of 10-bit samples in 16-bit words. `stride` counts samples. */
export interface Plane {
  samples: Uint16Array;
  stride: number;
  width: number;
  height: number;
}

/** A decoded picture of stream 2 (SPEC 4.1). Owned by whoever holds it; `release` gives its memory back. */
export interface DepthPicture {
  frame: bigint;
  capture_us: bigint;
  range: DepthRange;
  /** Inverse depth codes, 0 = nothing known. */
  depth: Plane;
  /** Half size: coverage of the actor, 4 x alpha. */
  coverage: Plane;
  /** Half size: 128 background or actor, 512 shadow, 896 unknown; the nearest counts. */
  label: Plane;
  release(): void;
}

export type Label = 'background' | 'actor' | 'shadow' | 'unknown';

// Halfway between two codes the lower one counts.
const kShadowAbove = (128 + 512) / 2;
const kUnknownAbove = (512 + 896) / 2;
const kActorFrom = 4 * 128; // half covered

/** What a sample pair of Cb and Cr says. Coverage decides between background and actor. */
export function labelOf(coverage: number, label: number): Label {
  if (label > kUnknownAbove) return 'unknown';
  if (label > kShadowAbove) return 'shadow';
  return coverage >= kActorFrom ? 'actor' : 'background';
}
