// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { watchUrl } from './worker_link';

describe('the watch address', () => {
  it.each([
    ['http://localhost:8080/', 'ws://localhost:8080/watch'],
    ['http://[::1]:8080/?a=1#b', 'ws://[::1]:8080/watch'],
    ['https://studio.example/show/', 'wss://studio.example/show/watch'],
  ])('of %s is %s', (page, watch) => expect(watchUrl(page)).toBe(watch));
});
