// SPDX-License-Identifier: Apache-2.0

/** Amount a second over a sliding window: pictures, bytes. */
export class RateMeter {
  readonly #window_ms: number;
  #events: { at_ms: number; amount: number }[] = [];

  constructor(window_ms = 2000) {
    this.#window_ms = window_ms;
  }

  add(at_ms: number, amount = 1): void {
    this.#events.push({ at_ms, amount });
    this.#forget(at_ms);
  }

  perSecond(now_ms: number): number {
    this.#forget(now_ms);
    const first = this.#events[0];
    if (first === undefined) return 0;
    // The first event opens the window and its amount was spent before it. A window that has only just begun is
    // not divided by next to nothing.
    const span_ms = Math.max(now_ms - first.at_ms, this.#window_ms / 4);
    const total = this.#events.reduce((sum, event) => sum + event.amount, 0) - first.amount;
    return (1000 * total) / span_ms;
  }

  reset(): void {
    this.#events = [];
  }

  #forget(now_ms: number): void {
    while (this.#events.length > 0 && now_ms - (this.#events[0]?.at_ms ?? 0) > this.#window_ms)
      this.#events.shift();
  }
}

/** Median of the last few values. */
export class MedianMeter {
  readonly #capacity: number;
  #values: number[] = [];

  constructor(capacity = 30) {
    this.#capacity = capacity;
  }

  add(value: number): void {
    this.#values.push(value);
    if (this.#values.length > this.#capacity) this.#values.shift();
  }

  get median(): number | null {
    const sorted = [...this.#values].sort((a, b) => a - b);
    return sorted[sorted.length >> 1] ?? null;
  }

  reset(): void {
    this.#values = [];
  }
}
