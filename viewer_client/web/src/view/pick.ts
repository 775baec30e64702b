// SPDX-License-Identifier: Apache-2.0
import type { SceneLight, SceneObject, Vector3 } from '../transport/scene';
import { dot, project, scale, sub, transform, type Pixel, type Viewpoint } from './geometry';

/** How far beside a small object a click still means it; beside the middle of a light's mark. */
const kReach_px = 8;
const kLightReach_px = 14;

/** The eight corners of the object's box, in the scene's frame. */
export function corners({ bounds, pose }: SceneObject): Vector3[] {
  return Array.from({ length: 8 }, (_, corner) => {
    const at = (axis: number): number => bounds[axis + 3 * ((corner >> axis) & 1)] ?? 0;
    return transform(pose, [at(0), at(1), at(2)]);
  });
}

/** Corners of the smallest convex polygon around points, in order; monotone chain. */
function hull(points: readonly Pixel[]): Pixel[] {
  const sorted = [...points].sort((a, b) => a.u - b.u || a.v - b.v);
  const left = (a: Pixel, b: Pixel, c: Pixel): boolean =>
    (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u) > 0;
  const half = (order: readonly Pixel[]): Pixel[] => {
    const chain: Pixel[] = [];
    for (const point of order) {
      for (;;) {
        const [a, b] = [chain.at(-2), chain.at(-1)];
        if (a === undefined || b === undefined || left(a, b, point)) break;
        chain.pop();
      }
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/** Distance of (u, v) to a convex polygon, 0 inside. */
function distance_px(polygon: readonly Pixel[], u: number, v: number): number {
  let inside = polygon.length > 2;
  let nearest = Infinity;
  polygon.forEach((a, index) => {
    const b = polygon[(index + 1) % polygon.length] ?? a;
    const [du, dv] = [b.u - a.u, b.v - a.v];
    if (du * (v - a.v) - dv * (u - a.u) < 0) inside = false;
    const along = ((u - a.u) * du + (v - a.v) * dv) / (du * du + dv * dv || 1);
    const t = Math.min(1, Math.max(0, along));
    nearest = Math.min(nearest, Math.hypot(u - a.u - t * du, v - a.v - t * dv));
  });
  return inside ? 0 : nearest;
}

/** The nearest visible object whose box the pixel lies on, or almost; null: none. */
export function pickObject(
  objects: readonly SceneObject[],
  view: Viewpoint,
  u: number,
  v: number,
): SceneObject | null {
  let best: SceneObject | null = null;
  let best_z_m = Infinity;
  for (const object of objects) {
    if (object.hidden) continue;
    const seen = corners(object).map((corner) => project(view, corner));
    // What reaches behind the camera surrounds it: nobody means that by a click.
    const pixels = seen.filter((pixel) => pixel !== null);
    if (pixels.length < seen.length) continue;
    const z_m = pixels.reduce((sum, pixel) => sum + pixel.z_m, 0) / pixels.length;
    if (z_m < best_z_m && distance_px(hull(pixels), u, v) <= kReach_px) {
      best = object;
      best_z_m = z_m;
    }
  }
  return best;
}

/** The nearest light whose mark the pixel lies on; null: none. One that shines from far away has no mark. */
export function pickLight(
  lights: readonly SceneLight[],
  view: Viewpoint,
  u: number,
  v: number,
): SceneLight | null {
  const seen = lights
    .filter(({ kind }) => kind !== 'directional')
    .map((light) => ({ light, pixel: project(view, light.position) }))
    .filter(({ pixel }) => pixel !== null && Math.hypot(pixel.u - u, pixel.v - v) <= kLightReach_px)
    .sort((a, b) => (a.pixel?.z_m ?? 0) - (b.pixel?.z_m ?? 0));
  return seen[0]?.light ?? null;
}

/** How high the object's box reaches above its base, along `up`. */
export function heightOf(object: SceneObject, up: Vector3): number {
  return Math.max(0, ...corners(object).map((corner) => dot(sub(corner, object.base), up)));
}

/** The middle of an object, for a camera to look at. */
export function middleOf(object: SceneObject, up: Vector3): Vector3 {
  const half = scale(up, heightOf(object, up) / 2);
  return [object.base[0] + half[0], object.base[1] + half[1], object.base[2] + half[2]];
}
