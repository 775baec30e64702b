// SPDX-License-Identifier: Apache-2.0
import type { FromWorker, ToWorker } from './messages';
import { Session } from './session';

// The worker's own scope, as far as it is used: lib.dom and lib.webworker do not go together.
interface WorkerScope {
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
  postMessage(message: FromWorker): void;
}

const kStatusEvery_ms = 100;
const scope = self as unknown as WorkerScope;
let session: Session | null = null;

scope.onmessage = ({ data }) => {
  if (data.type !== 'start') return session?.receive(data);
  const started = new Session(data, (message) => scope.postMessage(message));
  session = started;
  setInterval(() => scope.postMessage({ type: 'status', status: started.status }), kStatusEvery_ms);
};
