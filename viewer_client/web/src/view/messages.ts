// SPDX-License-Identifier: Apache-2.0
import type { DepthRange } from '../decode/depth_code';
import type { Hello, Refused, Subscription } from '../transport/control_message';
import type { Edit } from '../transport/edit';
import type { StreamName } from '../transport/picture_message';
import type { Scene } from '../transport/scene';
import type { Stats } from '../transport/stats';
import type { Link } from '../transport/watch_socket';
import type { ProbePoint, ProbeReading } from './depth_probe';

// What the page and its worker say to each other. The worker owns the connection, the decoders and the canvases of
// pictures; the 3D pane has a worker of its own (room_messages.ts).

export const kPictureNames = ['program', 'depth', 'matte'] as const;
export type PictureName = (typeof kPictureNames)[number];
export const kPaneNames = [...kPictureNames, 'room'] as const;
export type PaneName = (typeof kPaneNames)[number];
export type MatteMode = 'matte' | 'label' | 'light';

/** Which panes are to be drawn, and how large they are on the screen: device pixels across, 0 = hidden. */
export interface Shown {
  pane_px: Record<PaneName, number>;
  mode: MatteMode;
}

export type ToWorker =
  | {
      type: 'start';
      url: string;
      /** Of the last login in this tab; null: none. */
      token: string | null;
      canvases: Record<PictureName, OffscreenCanvas>;
      shown: Shown;
    }
  /** Where meshes go to: the 3D pane's worker. */
  | { type: 'meshes'; port: MessagePort }
  /** Null: log out. */
  | { type: 'login'; token: string | null }
  | { type: 'edit'; edit: Edit }
  | { type: 'show'; shown: Shown }
  | { type: 'freeze'; frozen: boolean }
  /** Null when no pointer stands on a picture. */
  | { type: 'probe'; point: ProbePoint | null };

export interface PictureSize {
  width: number;
  height: number;
}

export interface Status {
  link: Link;
  /** Who logged in; empty without login. */
  user: string;
  /** Colour pictures drawn since the page was opened. */
  color_frames: number;
  depth_frames: number;
  /** Number of the colour picture on the screen, as the server counts; decimal, as it may pass 2^53. */
  last_frame: string | null;
  size: PictureSize | null;
  /** Since the last picture was drawn; null before the first and while its stream is not wanted. */
  color_age_s: number | null;
  depth_age_s: number | null;
  matte_age_s: number | null;
  fps: number;
  /** Mid-exposure to drawn, by the server's clock: median of the last second. */
  latency_ms: number | null;
  megabits_per_s: number;
  round_trip_ms: number | null;
  /** Of the depth picture on the screen. */
  range: DepthRange | null;
  /** Number of the frozen depth picture. */
  frozen_frame: string | null;
  wanted: Subscription[];
  /** Streams that this browser cannot decode, with their codec string. */
  undecodable: Partial<Record<StreamName, string>>;
  /** How often a decoder was started again, and messages were not believed, with the last reason. */
  restarts: number;
  refused: number;
  last_trouble: string;
}

export type FromWorker =
  | { type: 'status'; status: Status }
  | { type: 'hello'; hello: Hello }
  | { type: 'stats'; stats: Stats }
  | { type: 'scene'; scene: Scene }
  | { type: 'refused'; refused: Refused }
  | { type: 'probe'; reading: ProbeReading | null };
