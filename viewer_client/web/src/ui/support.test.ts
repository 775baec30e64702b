// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { missingSupport } from './support';

const kFine = { secure: true, webcodecs: true, offscreen: true, host: 'studio' };

describe('support', () => {
  it('is silent in a browser that has everything', () => expect(missingSupport(kFine)).toBeNull());

  it('names the fix for a page over plain http, whatever else is hidden by it', () => {
    const missing = missingSupport({ ...kFine, secure: false, webcodecs: false });
    expect(missing?.advice).toContain('ssh -L 8080:localhost:8080 studio');
  });

  it('names what a browser lacks', () => {
    expect(missingSupport({ ...kFine, webcodecs: false })?.sentence).toContain('WebCodecs');
    expect(missingSupport({ ...kFine, offscreen: false })?.sentence).toContain('OffscreenCanvas');
  });
});
