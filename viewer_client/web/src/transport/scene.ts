// SPDX-License-Identifier: Apache-2.0
import {
  FieldError,
  amountAt,
  flagAt,
  idAt,
  numberAt,
  numbersAt,
  recordsAt,
  textAt,
  textsAt,
  type JsonRecord,
} from './json_fields';

export type Vector3 = [number, number, number];

export interface SceneObject {
  id: number;
  name: string;
  file: string;
  /** T_scene_object, row-major 4 x 4. */
  pose: number[];
  body: string;
  triangles: number;
  /** x0, y0, z0, x1, y1, z1 in the file's own coordinates. */
  bounds: number[];
  /** Middle of the object's lowest face, in the scene's frame. */
  base: Vector3;
  /** Of the shadow ring. */
  radius_m: number;
  hidden: boolean;
}

export interface SceneLight {
  id: number;
  name: string;
  kind: string;
  /** Null for light from far away. */
  position: Vector3 | null;
  /** Linear, 0..1 each. */
  color: Vector3;
  intensity: number;
}

/** SPEC 4.5: what stands in the show beside room and actor. */
export interface Scene {
  revision: number;
  frame: 'world' | 'camera';
  up: Vector3;
  can_undo: boolean;
  can_redo: boolean;
  unsaved: boolean;
  /** Who made the last change; empty when nobody did. */
  by: string;
  objects: SceneObject[];
  lights: SceneLight[];
  /** Files that may be added. */
  models: string[];
}

function vectorAt(record: JsonRecord, key: string): Vector3 {
  return numbersAt(record, key, 3) as Vector3;
}

function objectOf(record: JsonRecord): SceneObject {
  return {
    id: idAt(record, 'id'),
    name: textAt(record, 'name'),
    file: textAt(record, 'file'),
    pose: numbersAt(record, 'pose', 16),
    body: textAt(record, 'body'),
    triangles: amountAt(record, 'triangles'),
    bounds: numbersAt(record, 'bounds', 6),
    base: vectorAt(record, 'base'),
    radius_m: amountAt(record, 'radius_m'),
    hidden: flagAt(record, 'hidden'),
  };
}

function lightOf(record: JsonRecord): SceneLight {
  const placed = record['position'] !== undefined && record['position'] !== null;
  return {
    id: idAt(record, 'id'),
    name: textAt(record, 'name'),
    kind: textAt(record, 'kind'),
    position: placed ? vectorAt(record, 'position') : null,
    color: vectorAt(record, 'color'),
    intensity: amountAt(record, 'intensity'),
  };
}

function frameOf(record: JsonRecord): Scene['frame'] {
  const frame = record['frame'];
  if (frame !== 'world' && frame !== 'camera') throw new FieldError('frame is neither world nor camera');
  return frame;
}

function upOf(record: JsonRecord): Vector3 {
  const up = vectorAt(record, 'up');
  const length = Math.hypot(...up);
  if (Math.abs(length - 1) > 1e-3) throw new FieldError('up is not of length 1');
  return up;
}

/** Throws `FieldError` naming the field. */
export function sceneOf(record: JsonRecord): Scene {
  return {
    revision: numberAt(record, 'revision'),
    frame: frameOf(record),
    up: upOf(record),
    can_undo: flagAt(record, 'can_undo'),
    can_redo: flagAt(record, 'can_redo'),
    unsaved: flagAt(record, 'unsaved'),
    by: textAt(record, 'by'),
    objects: recordsAt(record, 'objects').map(objectOf),
    lights: recordsAt(record, 'lights').map(lightOf),
    models: textsAt(record, 'models'),
  };
}
