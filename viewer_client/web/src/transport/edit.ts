// SPDX-License-Identifier: Apache-2.0
import type { Vector3 } from './scene';

/** SPEC 4.5: what a director may do to the scene. `u`, `v` are pixels of the colour picture. */
export type EditOp =
  | { op: 'add'; file: string; u: number; v: number }
  /** To the room's surface under a pixel. */
  | { op: 'move'; object: number; u: number; v: number }
  /** Along the horizontal plane through the object's base. */
  | { op: 'move'; object: number; u: number; v: number; on: 'floor' }
  /** Where its base goes. */
  | { op: 'move'; object: number; position: Vector3 }
  | { op: 'turn'; object: number; angle_deg: number }
  | { op: 'drop'; object: number }
  | { op: 'delete'; object: number }
  | { op: 'hide'; object: number; hidden: boolean }
  /** One of its animations, or `kNoAnimation`. */
  | { op: 'animate'; object: number; animation: string }
  | { op: 'light'; light: number; position?: Vector3; color?: Vector3; intensity?: number }
  /** `turn_deg` is what it is from now on. */
  | { op: 'avatar'; position?: Vector3; turn_deg?: number }
  /** What stands still there in the foreground becomes the room's. */
  | { op: 'adopt'; u: number; v: number }
  /** All that was adopted is foreground again. */
  | { op: 'forget' }
  | { op: 'undo' }
  | { op: 'redo' }
  | { op: 'save' };

/** `live`: the middle of a drag, no step of undo; its last edit has `live` false. */
export type Edit = EditOp & { type: 'edit'; id: number; live?: boolean };
