// SPDX-License-Identifier: Apache-2.0
import {
  AmbientLight,
  DirectionalLight,
  Group,
  Raycaster,
  Scene as Graph,
  Vector2,
  type Camera,
} from 'three';
import { Mesh, type Object3D } from 'three';
import type { MeshData } from '../decode/draco_mesh';
import type { Pinhole } from '../transport/control_message';
import type { Scene, SceneObject, Vector3 } from '../transport/scene';
import { CameraPath } from './camera_path';
import { dot, origin, type Pose } from './geometry';
import type { MeshParcel } from './room_messages';
import { box, dispose, floorGrid, frustum, lightShape, matrixOf, ring, surface } from './room_shapes';

const kMostObjects = 256;
const kBoxColor = 0x66707b;
const kSelectedColor = 0x3ddbb4;
// A camera at standing height, where neither room nor objects say where the floor is.
const kGuessedCameraHeight_m = 1.5;

/** All that the 3D pane shows, in the scene's frame. Every change that is to be seen is made here. */
export class RoomScene {
  readonly graph = new Graph();
  readonly #surfaces = new Group();
  readonly #marks = new Group();
  readonly #rig = new Group();
  readonly #path = new CameraPath();
  readonly #sun = new DirectionalLight(0xffffff, 1.6);
  /** Meshes of objects by id, in the file's own coordinates. */
  readonly #objects = new Map<number, Mesh>();
  #room: Mesh | null = null;
  #actor: Mesh | null = null;
  #grid: Object3D | null = null;
  #lowest_m: number | null = null;
  #scene: Scene | null = null;
  #selected: number | null = null;

  constructor() {
    this.#rig.matrixAutoUpdate = false;
    this.#rig.visible = false;
    this.graph.add(
      this.#surfaces,
      this.#marks,
      this.#rig,
      this.#path.line,
      this.#sun,
      new AmbientLight(0xffffff, 1.4),
    );
  }

  setScene(scene: Scene): void {
    const other_up = this.#scene === null || scene.up.some((value, axis) => value !== this.#scene?.up[axis]);
    this.#scene = scene;
    const known = new Set(scene.objects.map((object) => object.id));
    for (const id of [...this.#objects.keys()]) if (!known.has(id)) this.#drop(id);
    if (other_up) {
      this.#sun.position.set(...scene.up);
      this.#lowest_m = this.#lowestOf(this.#room);
    }
    this.#layGrid();
    this.#mark();
  }

  select(id: number | null): void {
    this.#selected = id;
    this.#mark();
  }

  setPinhole(pinhole: Pinhole): void {
    this.#rig.children.forEach(dispose);
    this.#rig.clear();
    this.#rig.add(frustum(pinhole));
  }

  setPose(T_scene_color: Pose): void {
    this.#rig.matrix.copy(matrixOf(T_scene_color));
    this.#rig.visible = true;
    this.#path.add(origin(T_scene_color));
  }

  /** Takes the texture over. `data` null: the actor is out of view. */
  put(parcel: Pick<MeshParcel, 'stream' | 'id'>, data: MeshData | null, texture: ImageBitmap | null): void {
    const shape = data === null ? null : surface(data, texture);
    if (parcel.stream === 'actor') {
      this.#replace(this.#actor, shape);
      this.#actor = shape;
      return;
    }
    if (shape === null) return;
    if (parcel.stream === 'room') {
      this.#replace(this.#room, shape);
      this.#room = shape;
      this.#lowest_m = this.#lowestOf(shape);
      this.#layGrid();
      return;
    }
    this.#drop(parcel.id);
    shape.matrixAutoUpdate = false;
    this.#objects.set(parcel.id, shape);
    this.#surfaces.add(shape);
    const [oldest] = this.#objects.keys();
    if (this.#objects.size > kMostObjects && oldest !== undefined) this.#drop(oldest);
    this.#mark();
  }

  clear(): void {
    this.#replace(this.#actor, null);
    this.#replace(this.#room, null);
    this.#actor = null;
    this.#room = null;
    this.#lowest_m = null;
    for (const id of [...this.#objects.keys()]) this.#drop(id);
    this.#path.clear();
    this.#rig.visible = false;
  }

  /** The nearest surface under a place of the pane, -1..1 right and up. */
  touch(camera: Camera, right: number, above: number): Vector3 | null {
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2(right, above), camera);
    const targets = this.#surfaces.children.filter((shape) => shape.visible);
    const hit = caster.intersectObjects(targets, false)[0];
    return hit === undefined ? null : [hit.point.x, hit.point.y, hit.point.z];
  }

  #replace(before: Mesh | null, after: Mesh | null): void {
    if (before !== null) {
      this.#surfaces.remove(before);
      dispose(before);
    }
    if (after !== null) this.#surfaces.add(after);
  }

  #drop(id: number): void {
    this.#replace(this.#objects.get(id) ?? null, null);
    this.#objects.delete(id);
  }

  /** Puts every object where it is now, and draws anew what stands for it. */
  #mark(): void {
    this.#marks.children.forEach(dispose);
    this.#marks.clear();
    if (this.#scene === null) return;
    for (const object of this.#scene.objects) this.#markObject(object, this.#scene.up);
    for (const light of this.#scene.lights) {
      const shape = lightShape(light);
      if (shape !== null) this.#marks.add(shape);
    }
  }

  #markObject(object: SceneObject, up: Vector3): void {
    const shape = this.#objects.get(object.id);
    if (shape !== undefined) {
      shape.visible = !object.hidden;
      shape.matrix.copy(matrixOf(object.pose));
    }
    const selected = object.id === this.#selected;
    if (selected) this.#marks.add(ring(object, up));
    if (selected || (shape === undefined && !object.hidden))
      this.#marks.add(box(object, selected ? kSelectedColor : kBoxColor));
  }

  #layGrid(): void {
    if (this.#scene === null) return;
    const { frame, up, objects } = this.#scene;
    // In the world the floor is at 0. Of a camera's scene it is the lowest that is known.
    const bases = objects.map((object) => dot(object.base, up));
    const lowest_m = this.#lowest_m ?? (bases.length > 0 ? Math.min(...bases) : -kGuessedCameraHeight_m);
    if (this.#grid !== null) {
      this.graph.remove(this.#grid);
      dispose(this.#grid);
    }
    this.#grid = floorGrid(up, frame === 'world' ? 0 : lowest_m);
    this.graph.add(this.#grid);
  }

  /** Height that a fiftieth of the vertices lie below: single stray ones do not dig the floor. */
  #lowestOf(room: Mesh | null): number | null {
    const positions = room?.geometry.getAttribute('position');
    const up = this.#scene?.up;
    if (positions === undefined || up === undefined || positions.count === 0) return null;
    const every = Math.max(1, Math.floor(positions.count / 2000));
    const heights: number[] = [];
    for (let index = 0; index < positions.count; index += every)
      heights.push(dot([positions.getX(index), positions.getY(index), positions.getZ(index)], up));
    heights.sort((a, b) => a - b);
    return heights[Math.floor(heights.length / 50)] ?? null;
  }
}
