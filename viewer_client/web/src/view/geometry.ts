// SPDX-License-Identifier: Apache-2.0
import type { Pinhole } from '../transport/control_message';
import type { Vector3 } from '../transport/scene';

// Points and rays in the scene's frame; cameras are x right, y down, z forward.

export function add(a: Vector3, b: Vector3): Vector3 {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function sub(a: Vector3, b: Vector3): Vector3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

export function scale(a: Vector3, factor: number): Vector3 {
  return [a[0] * factor, a[1] * factor, a[2] * factor];
}

export function dot(a: Vector3, b: Vector3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross(a: Vector3, b: Vector3): Vector3 {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function normalize(a: Vector3): Vector3 {
  return scale(a, 1 / Math.hypot(...a));
}

/** Two directions that span the horizontal plane, with `up` a right-handed frame: e0 x e1 = up. */
export function horizontal(up: Vector3): [Vector3, Vector3] {
  const axis: Vector3 = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 0, 1];
  const e0 = normalize(sub(axis, scale(up, dot(axis, up))));
  return [e0, cross(up, e0)];
}

// Straight up there would be no sideways.
const kSteepest_rad = (89 * Math.PI) / 180;

/** A direction of length 1 turned about `up`, and raised towards it. */
export function turned(direction: Vector3, around_rad: number, raised_rad: number, up: Vector3): Vector3 {
  const [e0, e1] = horizontal(up);
  const azimuth = Math.atan2(dot(direction, e1), dot(direction, e0)) + around_rad;
  const elevation = Math.asin(Math.min(1, Math.max(-1, dot(direction, up)))) + raised_rad;
  const kept = Math.min(kSteepest_rad, Math.max(-kSteepest_rad, elevation));
  const around = add(scale(e0, Math.cos(azimuth)), scale(e1, Math.sin(azimuth)));
  return add(scale(around, Math.cos(kept)), scale(up, Math.sin(kept)));
}

/** Rows of a rigid 3 x 4 matrix T_a_b, or of the upper part of a 4 x 4 one. */
export type Pose = readonly number[];

export const kIdentityPose: Pose = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

function row(T: Pose, index: number): Vector3 {
  return [T[4 * index] ?? 0, T[4 * index + 1] ?? 0, T[4 * index + 2] ?? 0];
}

export function origin(T: Pose): Vector3 {
  return [T[3] ?? 0, T[7] ?? 0, T[11] ?? 0];
}

export function rotate(T: Pose, direction: Vector3): Vector3 {
  return [dot(row(T, 0), direction), dot(row(T, 1), direction), dot(row(T, 2), direction)];
}

/** p_a = T_a_b p_b. Holds for any affine T. */
export function transform(T: Pose, point: Vector3): Vector3 {
  return add(rotate(T, point), origin(T));
}

/** p_b of p_a, for a rigid T_a_b. */
export function transformBack(T: Pose, point: Vector3): Vector3 {
  const moved = sub(point, origin(T));
  return add(add(scale(row(T, 0), moved[0]), scale(row(T, 1), moved[1])), scale(row(T, 2), moved[2]));
}

/** A camera that looks: where it stands and how it projects. */
export interface Viewpoint {
  T_scene_camera: Pose;
  pinhole: Pinhole;
}

export interface Pixel {
  u: number;
  v: number;
  /** Along the optical axis. */
  z_m: number;
}

// Nearer than this nothing is projected: it would be beside or behind the camera.
const kNearest_m = 0.05;

/** Pixel of a point, lens distortion left out; null behind the camera. It may lie outside the picture. */
export function project({ T_scene_camera, pinhole }: Viewpoint, point: Vector3): Pixel | null {
  const [x, y, z] = transformBack(T_scene_camera, point);
  if (!(z > kNearest_m)) return null;
  return { u: (pinhole.fx * x) / z + pinhole.cx, v: (pinhole.fy * y) / z + pinhole.cy, z_m: z };
}

/** The point that is seen at a pixel, z_m along the optical axis. */
export function unproject(
  { T_scene_camera, pinhole }: Viewpoint,
  { u, v }: { u: number; v: number },
  z_m: number,
): Vector3 {
  const [x, y] = [(u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy];
  return transform(T_scene_camera, [x * z_m, y * z_m, z_m]);
}

export interface Ray {
  from: Vector3;
  /** Of length 1. */
  along: Vector3;
}

export function rayThrough({ T_scene_camera, pinhole }: Viewpoint, u: number, v: number): Ray {
  const direction: Vector3 = [(u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy, 1];
  return { from: origin(T_scene_camera), along: normalize(rotate(T_scene_camera, direction)) };
}

// A ray flatter than this meets the floor so far away that a pixel is metres.
const kFlattest = 0.02;

/** Where a ray meets the horizontal plane through `on`; null above the horizon. */
export function meetPlane(ray: Ray, up: Vector3, on: Vector3): Vector3 | null {
  const steep = dot(ray.along, up);
  if (Math.abs(steep) < kFlattest) return null;
  const length = dot(sub(on, ray.from), up) / steep;
  return length > 0 ? add(ray.from, scale(ray.along, length)) : null;
}

/** Points of a horizontal circle. */
export function circle(centre: Vector3, radius_m: number, up: Vector3, count: number): Vector3[] {
  const [e0, e1] = horizontal(up);
  return Array.from({ length: count }, (_, index) => {
    const angle = (2 * Math.PI * index) / count;
    const across = add(scale(e0, Math.cos(angle)), scale(e1, Math.sin(angle)));
    return add(centre, scale(across, radius_m));
  });
}
