// SPDX-License-Identifier: Apache-2.0
import {
  FieldError,
  amountAt,
  choiceAt,
  flagAt,
  idAt,
  numberAt,
  numbersAt,
  recordOf,
  recordsAt,
  textAt,
  textsAt,
  type JsonRecord,
} from './json_fields';

export type Vector3 = [number, number, number];

const kFrames = ['world', 'camera'] as const;
const kBodies = ['isolated', 'mutual', 'actor'] as const;
const kLightKinds = ['area', 'directional', 'point'] as const;

export interface SceneObject {
  id: number;
  name: string;
  file: string;
  /** T_scene_object, row-major 4 x 4. */
  pose: number[];
  body: (typeof kBodies)[number];
  triangles: number;
  /** x0, y0, z0, x1, y1, z1 in the file's own coordinates. */
  bounds: number[];
  /** Middle of the object's lowest face, in the scene's frame. */
  base: Vector3;
  /** Of the shadow ring. */
  radius_m: number;
  hidden: boolean;
  /** What its file can play, and what it plays again and again; missing where that is nothing. */
  animations?: string[];
  animation?: string;
}

/** SPEC 7: `animation` of an object that stands. */
export const kNoAnimation = 'none';

export interface SceneLight {
  id: number;
  name: string;
  kind: (typeof kLightKinds)[number];
  /** In the scene's frame, metres; of a directional light the unit vector toward it. */
  position: Vector3;
  /** Linear, 0..1 each. */
  color: Vector3;
  intensity: number;
}

/** SPEC 7: the actor in another space. */
export interface SceneAvatar {
  /** Where `anchor` of his own floor lies in the scene, metres. */
  position: Vector3;
  /** About up, through it. */
  turn_deg: number;
}

/** SPEC 4.5: what stands in the show beside room and actor. */
export interface Scene {
  revision: number;
  frame: (typeof kFrames)[number];
  up: Vector3;
  can_undo: boolean;
  can_redo: boolean;
  unsaved: boolean;
  /** Who made the last change; empty when nobody did. */
  by: string;
  /** Accepted so far: what moves while it stays is moved by physics. */
  edits: number;
  objects: SceneObject[];
  lights: SceneLight[];
  avatar?: SceneAvatar;
  /** Things left behind that are the room's now; missing where there are none. */
  adopted?: number;
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
    body: choiceAt(record, 'body', kBodies),
    triangles: amountAt(record, 'triangles'),
    bounds: numbersAt(record, 'bounds', 6),
    base: vectorAt(record, 'base'),
    radius_m: amountAt(record, 'radius_m'),
    hidden: flagAt(record, 'hidden'),
    ...('animations' in record
      ? { animations: textsAt(record, 'animations'), animation: textAt(record, 'animation') }
      : {}),
  };
}

function lightOf(record: JsonRecord): SceneLight {
  return {
    id: idAt(record, 'id'),
    name: textAt(record, 'name'),
    kind: choiceAt(record, 'kind', kLightKinds),
    position: vectorAt(record, 'position'),
    color: vectorAt(record, 'color'),
    intensity: amountAt(record, 'intensity'),
  };
}

function upOf(record: JsonRecord): Vector3 {
  const up = vectorAt(record, 'up');
  const length = Math.hypot(...up);
  if (Math.abs(length - 1) > 1e-3) throw new FieldError('up is not of length 1');
  return up;
}

function avatarOf(record: JsonRecord): SceneAvatar {
  return { position: vectorAt(record, 'position'), turn_deg: numberAt(record, 'turn_deg') };
}

/** Throws `FieldError` naming the field. */
export function sceneOf(record: JsonRecord): Scene {
  return {
    revision: numberAt(record, 'revision'),
    frame: choiceAt(record, 'frame', kFrames),
    up: upOf(record),
    can_undo: flagAt(record, 'can_undo'),
    can_redo: flagAt(record, 'can_redo'),
    unsaved: flagAt(record, 'unsaved'),
    by: textAt(record, 'by'),
    edits: amountAt(record, 'edits'),
    objects: recordsAt(record, 'objects').map(objectOf),
    lights: recordsAt(record, 'lights').map(lightOf),
    models: textsAt(record, 'models'),
    ...('adopted' in record ? { adopted: amountAt(record, 'adopted') } : {}),
    ...('avatar' in record ? { avatar: avatarOf(recordOf(record['avatar'], 'avatar')) } : {}),
  };
}
