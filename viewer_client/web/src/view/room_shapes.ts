// SPDX-License-Identifier: Apache-2.0
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  Group,
  LineBasicMaterial,
  LineLoop,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  OctahedronGeometry,
  SRGBColorSpace,
  Texture,
  type Object3D,
} from 'three';
import type { MeshData } from '../decode/draco_mesh';
import type { Pinhole } from '../transport/control_message';
import type { SceneLight, SceneObject, Vector3 } from '../transport/scene';
import { add, circle, horizontal, scale, type Pose } from './geometry';
import { corners } from './pick';

// The 3D pane's shapes, each made whole and thrown away whole.

const kGridReach_m = 8;
const kGridColor = 0x30363e;
const kGridAxisColor = 0x4a535e;
const kRigColor = 0xe6e9ec;
const kAccent = 0x3ddbb4;
const kFrustum_m = 0.6;
const kRingPoints = 48;
const kLight_m = 0.09;

export function matrixOf(T: Pose): Matrix4 {
  const at = (index: number): number => T[index] ?? 0;
  return new Matrix4().set(
    at(0),
    at(1),
    at(2),
    at(3),
    at(4),
    at(5),
    at(6),
    at(7),
    at(8),
    at(9),
    at(10),
    at(11),
    0,
    0,
    0,
    1,
  );
}

function points(list: readonly Vector3[]): BufferGeometry {
  return new BufferGeometry().setAttribute('position', new BufferAttribute(new Float32Array(list.flat()), 3));
}

function lines(list: readonly Vector3[], color: number): LineSegments {
  return new LineSegments(points(list), new LineBasicMaterial({ color }));
}

/** Gives back the graphics memory of a shape and of all that hangs on it. */
export function dispose(shape: Object3D): void {
  shape.traverse((part) => {
    if (!(part instanceof Mesh) && !(part instanceof LineSegments) && !(part instanceof LineLoop)) return;
    part.geometry.dispose();
    const material: unknown = part.material;
    if (material instanceof MeshBasicMaterial) {
      const bitmap: unknown = material.map?.image;
      if (bitmap instanceof ImageBitmap) bitmap.close();
      material.map?.dispose();
    }
    part.material.dispose();
  });
}

/** One line a metre on the floor; the two through `origin_m`'s nearest whole metres are brighter. */
export function floorGrid(up: Vector3, height_m: number): Group {
  const [e0, e1] = horizontal(up);
  const at = (a: number, b: number): Vector3 => add(add(scale(e0, a), scale(e1, b)), scale(up, height_m));
  const fine: Vector3[] = [];
  for (let step = -kGridReach_m; step <= kGridReach_m; ++step) {
    if (step === 0) continue;
    fine.push(
      at(step, -kGridReach_m),
      at(step, kGridReach_m),
      at(-kGridReach_m, step),
      at(kGridReach_m, step),
    );
  }
  const axes = [at(0, -kGridReach_m), at(0, kGridReach_m), at(-kGridReach_m, 0), at(kGridReach_m, 0)];
  return new Group().add(lines(fine, kGridColor), lines(axes, kGridAxisColor));
}

/** What the rig's camera sees, as the edges of a pyramid; in the camera's own frame. */
export function frustum({ width, height, fx, fy, cx, cy }: Pinhole): LineSegments {
  const corner = (u: number, v: number): Vector3 => scale([(u - cx) / fx, (v - cy) / fy, 1], kFrustum_m);
  const [a, b, c, d] = [
    corner(-0.5, -0.5),
    corner(width - 0.5, -0.5),
    corner(width - 0.5, height - 0.5),
    corner(-0.5, height - 0.5),
  ];
  const eye: Vector3 = [0, 0, 0];
  // A small roof over the upper edge says which way is up.
  const roof = corner((width - 1) / 2, -0.5 - 0.12 * height);
  return lines([eye, a, eye, b, eye, c, eye, d, a, b, b, c, c, d, d, a, a, roof, roof, b], kRigColor);
}

/** Where an object stands: its shadow ring. */
export function ring(object: SceneObject, up: Vector3): LineLoop {
  const radius_m = Math.max(0.02, object.radius_m);
  return new LineLoop(
    points(circle(add(object.base, scale(up, 0.005)), radius_m, up, kRingPoints)),
    new LineBasicMaterial({ color: kAccent, depthTest: false }),
  );
}

/** The edges of an object's box: in place of a mesh that has not come, and around what is selected. */
export function box(object: SceneObject, color: number): LineSegments {
  const all = corners(object);
  const edges: Vector3[] = [];
  for (let from = 0; from < 8; ++from) {
    for (const axis of [1, 2, 4]) {
      const [a, b] = [all[from], all[from | axis]];
      if ((from & axis) === 0 && a !== undefined && b !== undefined) edges.push(a, b);
    }
  }
  return lines(edges, color);
}

/** A light as a small shape of its colour; nothing for one that shines from far away. */
export function lightShape(light: SceneLight): Mesh | null {
  if (light.kind === 'directional') return null;
  const color = new Color().setRGB(...light.color);
  if (light.intensity === 0) color.multiplyScalar(0.25);
  const shape = new Mesh(new OctahedronGeometry(kLight_m), new MeshBasicMaterial({ color }));
  shape.position.set(...light.position);
  return shape;
}

// sRGB bytes to linear light.
const kLinear = Float32Array.from({ length: 256 }, (_, byte) => {
  const value = byte / 255;
  return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
});

/** A mesh with its texture, which it takes over, or its colours; plain grey when it has neither. */
export function surface(data: MeshData, texture: ImageBitmap | null): Mesh {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(data.positions, 3));
  geometry.setIndex(new BufferAttribute(data.indices, 1));
  if (texture !== null && data.uvs !== null) {
    geometry.setAttribute('uv', new BufferAttribute(data.uvs, 2));
    const map = new Texture(texture);
    // Row 0 is v = 0, as it is uploaded; the picture is already lit.
    map.flipY = false;
    map.colorSpace = SRGBColorSpace;
    map.needsUpdate = true;
    return new Mesh(geometry, new MeshBasicMaterial({ map, side: DoubleSide }));
  }
  texture?.close();
  if (data.normals !== null) geometry.setAttribute('normal', new BufferAttribute(data.normals, 3));
  else geometry.computeVertexNormals();
  const colored = data.colors !== null;
  if (data.colors !== null) {
    const linear = Float32Array.from(data.colors, (byte) => kLinear[byte] ?? 0);
    geometry.setAttribute('color', new BufferAttribute(linear, 3));
  }
  return new Mesh(
    geometry,
    new MeshLambertMaterial({
      vertexColors: colored,
      color: colored ? 0xffffff : 0x8a929c,
      side: DoubleSide,
    }),
  );
}
