// SPDX-License-Identifier: Apache-2.0
import { defineConfig } from 'vite';

// The server sends `default-src 'self'`, and WebAssembly is all that its scripts may evaluate: nothing may be inlined into the HTML and nothing fetched from elsewhere.
export default defineConfig({
  base: './',
  build: {
    target: 'es2022',
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    emptyOutDir: true,
    // Draco's decoder asks for these under Node only.
    commonjsOptions: { ignore: ['node:fs', 'node:path', 'fs', 'path'] },
  },
  worker: { format: 'es' },
  server: {
    proxy: Object.fromEntries(
      ['/watch', '/login', '/healthz'].map((path) => [
        path,
        { target: process.env['MIXSTAGE_SERVER'] ?? 'http://127.0.0.1:8080', ws: path === '/watch' },
      ]),
    ),
  },
});
