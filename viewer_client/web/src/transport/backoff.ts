// SPDX-License-Identifier: Apache-2.0

/** Waiting times between attempts: 0.5, 1, 2, 4, 4, ... s. */
export class Backoff {
  #attempts = 0;

  /** Attempts since the last success. */
  get attempts(): number {
    return this.#attempts;
  }

  /** Counts one more attempt and says how long to wait before it. */
  next_ms(): number {
    const wait_ms = Math.min(4000, 500 * 2 ** this.#attempts);
    this.#attempts += 1;
    return wait_ms;
  }

  succeeded(): void {
    this.#attempts = 0;
  }
}
