// SPDX-License-Identifier: Apache-2.0
import { defineConfig } from 'vite';

// The server sends `default-src 'self'`: nothing may be inlined into the HTML and nothing fetched from elsewhere.
export default defineConfig({
  base: './',
  build: {
    target: 'es2022',
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    emptyOutDir: true,
  },
  worker: { format: 'es' },
  server: {
    proxy: { '/watch': { target: process.env['MIXSTAGE_SERVER'] ?? 'http://127.0.0.1:8080', ws: true } },
  },
});
