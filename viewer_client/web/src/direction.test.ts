// SPDX-License-Identifier: Apache-2.0
import { readFileSync, readdirSync } from 'node:fs';
import { describe, expect, it } from 'vitest';

// Data flows transport -> decode -> view -> ui; a folder imports only from itself and from those before it.
const kFolders = ['transport', 'decode', 'view', 'ui'];
const kSource = new URL('.', import.meta.url);

describe.each(kFolders)('%s', (folder) => {
  const files = readdirSync(new URL(folder, kSource)).filter((name) => name.endsWith('.ts'));

  it('has files', () => expect(files.length).toBeGreaterThan(0));

  it.each(files)('%s imports only from what comes before it', (file) => {
    const text = readFileSync(new URL(`${folder}/${file}`, kSource), 'utf8');
    const allowed = kFolders.slice(0, kFolders.indexOf(folder));
    for (const [, from] of text.matchAll(/from '\.\.\/(\w+)\//g)) expect(allowed).toContain(from);
  });
});
