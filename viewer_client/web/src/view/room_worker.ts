// SPDX-License-Identifier: Apache-2.0
import draco_wasm from 'draco3d/draco_decoder.wasm?url';
import { DracoReader } from '../decode/draco_mesh';
import type { FromRoom, ToRoom, ToRoomFromSession } from './room_messages';
import { RoomView } from './room_view';

// The worker's own scope, as far as it is used: lib.dom and lib.webworker do not go together.
interface WorkerScope {
  onmessage: ((event: MessageEvent<ToRoom>) => void) | null;
  postMessage(message: FromRoom): void;
  requestAnimationFrame(callback: () => void): number;
}

const kCountsEvery_ms = 500;
const scope = self as unknown as WorkerScope;
let view: RoomView | null = null;

async function fetchDraco(): Promise<ArrayBuffer> {
  const reply = await fetch(draco_wasm);
  if (!reply.ok) throw new Error(`the decoder could not be loaded (${reply.status})`);
  return reply.arrayBuffer();
}

/** A slow machine spends at most half its time on this pane: what else it does is shown more often. */
function schedule(draw: () => void): void {
  const rest_ms = view?.counts.draw_ms ?? 0;
  if (rest_ms < 10) scope.requestAnimationFrame(draw);
  else setTimeout(() => scope.requestAnimationFrame(draw), rest_ms);
}

function start({ canvas, meshes, look }: Extract<ToRoom, { type: 'start' }>): void {
  let started: RoomView;
  try {
    started = new RoomView(
      canvas,
      look,
      new DracoReader(fetchDraco),
      (message) => scope.postMessage(message),
      schedule,
    );
  } catch {
    // three says what it tried on the console; a person needs the browser's setting.
    const sentence =
      'This browser gives no WebGL 2, which draws the 3D view. Switch on hardware acceleration.';
    scope.postMessage({ type: 'trouble', sentence });
    return;
  }
  view = started;
  meshes.onmessage = ({ data }: MessageEvent<ToRoomFromSession>) =>
    data.type === 'mesh' ? started.push(data.parcel) : started.forget();
  setInterval(() => scope.postMessage({ type: 'counts', counts: started.counts }), kCountsEvery_ms);
}

scope.onmessage = ({ data }) => {
  if (data.type === 'start') return start(data);
  if (view === null) return;
  if (data.type === 'look') return view.look(data.look);
  if (data.type === 'touch') return scope.postMessage({ type: 'touched', point: view.touch(data.u, data.v) });
  if (data.type === 'scene') view.scene.setScene(data.scene);
  if (data.type === 'rig') view.scene.setPinhole(data.pinhole);
  if (data.type === 'select') view.scene.select(data.id);
  view.redraw();
};
