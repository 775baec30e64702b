// SPDX-License-Identifier: Apache-2.0
import type { Scene } from '../transport/scene';
import type { ProbeReading } from '../view/depth_probe';
import type { Status } from '../view/messages';
import type { RoomCounts } from '../view/room_messages';
import { setData } from './dom';
import type { State } from './state_sentence';

// Counters on the root element for whoever watches the page from outside, such as the browser test.

export function publishState(root: HTMLElement, state: State, status: Status | null): void {
  setData(root, 'state', state.word);
  if (status === null) return;
  setData(root, 'link', status.link.phase);
  setData(root, 'frames', `${status.color_frames}`);
  setData(root, 'depthFrames', `${status.depth_frames}`);
  setData(root, 'frame', status.last_frame ?? '');
  setData(root, 'streams', status.wanted.join(' '));
  setData(root, 'restarts', `${status.restarts}`);
  setData(root, 'refused', `${status.refused}`);
  setData(root, 'trouble', status.last_trouble);
}

export function publishReading(root: HTMLElement, reading: ProbeReading | null): void {
  setData(root, 'probe', reading === null ? '' : JSON.stringify(reading));
}

export function publishRoom(root: HTMLElement, counts: RoomCounts | null): void {
  if (counts !== null) setData(root, 'room', JSON.stringify(counts));
}

export function publishScene(root: HTMLElement, scene: Scene | null): void {
  setData(root, 'scene', scene === null ? '' : JSON.stringify(scene));
}
