// SPDX-License-Identifier: Apache-2.0
import type { MeshParcel } from './room_messages';

// Actor, room and as many objects as a scene may have.
const kMostWaiting = 258;

/** Meshes that wait to be decoded: of each thing only the newest. */
export class MeshInbox {
  readonly #waiting = new Map<string, MeshParcel>();
  #superseded = 0;

  push(parcel: MeshParcel): void {
    const key = `${parcel.stream} ${parcel.id}`;
    // What is replaced keeps its turn: an actor at 12.5 Hz cannot push itself to the end for ever.
    if (this.#waiting.has(key)) this.#superseded += 1;
    this.#waiting.set(key, parcel);
    if (this.#waiting.size <= kMostWaiting) return;
    const [oldest] = this.#waiting.keys();
    if (oldest !== undefined) this.#waiting.delete(oldest);
    this.#superseded += 1;
  }

  /** The one that has waited longest; null: none. */
  take(): MeshParcel | null {
    const [first] = this.#waiting;
    if (first === undefined) return null;
    this.#waiting.delete(first[0]);
    return first[1];
  }

  clear(): void {
    this.#waiting.clear();
  }

  get superseded(): number {
    return this.#superseded;
  }
}
