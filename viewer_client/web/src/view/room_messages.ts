// SPDX-License-Identifier: Apache-2.0
import type { Pinhole } from '../transport/control_message';
import type { MeshStream } from '../transport/mesh_message';
import type { Scene, Vector3 } from '../transport/scene';
import type { Pose } from './geometry';

// What the page, the session's worker and the 3D pane's worker say to each other.

/** A mesh on its way from the session's worker, which hands its memory over. */
export interface MeshParcel {
  stream: MeshStream;
  id: number;
  T_scene_color: readonly number[];
  mesh: Uint8Array;
  texture: Uint8Array;
}

/** `forget`: another connection, perhaps another show. */
export type ToRoomFromSession = { type: 'mesh'; parcel: MeshParcel } | { type: 'forget' };

/** How the pane is looked at; a width of 0 hides it. Device pixels. */
export interface Look {
  width: number;
  height: number;
  T_scene_eye: Pose;
  vertical_field_rad: number;
}

export type ToRoom =
  | { type: 'start'; canvas: OffscreenCanvas; meshes: MessagePort; look: Look }
  | { type: 'look'; look: Look }
  | { type: 'scene'; scene: Scene }
  | { type: 'rig'; pinhole: Pinhole }
  | { type: 'select'; id: number | null }
  /** Asks what lies under a place of the pane, 0..1 from its left and upper edge. */
  | { type: 'touch'; u: number; v: number };

/** For the details and for whoever watches the page from outside. */
export interface RoomCounts {
  drawn: number;
  meshes: number;
  /** Meshes that a newer one replaced before they were decoded. */
  superseded: number;
  refused: number;
  last_trouble: string;
  triangles: number;
  draw_ms: number;
}

export type FromRoom =
  | { type: 'pose'; T_scene_color: Pose }
  | { type: 'touched'; point: Vector3 | null }
  | { type: 'counts'; counts: RoomCounts }
  /** Why nothing can be drawn; empty: it can again. */
  | { type: 'trouble'; sentence: string };
