// SPDX-License-Identifier: Apache-2.0

export interface BrowserParts {
  secure: boolean;
  webcodecs: boolean;
  offscreen: boolean;
  host: string;
}

/** What this browser lacks and how to mend it; null when nothing. */
export function missingSupport(parts: BrowserParts): { sentence: string; advice: string } | null {
  if (!parts.secure) {
    return {
      sentence: 'Browsers decode video only on pages that came over a secure connection.',
      advice: `Open this page over https://, or run\nssh -L 8080:localhost:8080 ${parts.host}\nand open http://localhost:8080/`,
    };
  }
  if (!parts.webcodecs || !parts.offscreen) {
    return {
      sentence: `This browser lacks ${parts.webcodecs ? 'OffscreenCanvas' : 'WebCodecs'}, which decodes the pictures.`,
      advice: 'Open the page in a current Chromium, Chrome or Edge.',
    };
  }
  return null;
}

export function browserParts(): BrowserParts {
  return {
    secure: window.isSecureContext,
    webcodecs: 'VideoDecoder' in window,
    offscreen: 'transferControlToOffscreen' in HTMLCanvasElement.prototype,
    host: location.hostname,
  };
}
