// SPDX-License-Identifier: Apache-2.0

interface Sample {
  offset_us: number;
  round_trip_us: number;
}

/**
 * What to add to this machine's clock to get the server's. The exchange with the smallest round trip of the
 * last `capacity` is believed: its error is at most half that round trip. A bounded memory follows drift.
 */
export class ClockOffset {
  readonly #capacity: number;
  #samples: Sample[] = [];
  #best: Sample | null = null;

  constructor(capacity = 20) {
    this.#capacity = capacity;
  }

  addExchange(sent_us: number, server_us: number, received_us: number): void {
    const round_trip_us = received_us - sent_us;
    if (!(round_trip_us >= 0)) return; // our own clock was set back in between
    this.#samples.push({ offset_us: server_us - (sent_us + received_us) / 2, round_trip_us });
    if (this.#samples.length > this.#capacity) this.#samples.shift();
    this.#best = this.#samples.reduce((best, next) =>
      next.round_trip_us <= best.round_trip_us ? next : best,
    );
  }

  /** Null until the first exchange. */
  get offset_us(): number | null {
    return this.#best?.offset_us ?? null;
  }

  get round_trip_us(): number | null {
    return this.#best?.round_trip_us ?? null;
  }

  /** A new connection may be a new server with another clock. */
  reset(): void {
    this.#samples = [];
    this.#best = null;
  }
}
