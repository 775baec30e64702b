// SPDX-License-Identifier: Apache-2.0
//
// Holds GLB files against the glTF 2.0 specification with Khronos' validator: node validate_glb.mjs FILE...
// Prints each error and warning; ends with 1 when there was one.
import { readFileSync } from 'node:fs';
import validator from 'gltf-validator';

let found = 0;
for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 20 });
  for (const issue of report.issues.messages) {
    if (issue.severity > 1) continue; // 0 error, 1 warning
    console.log(`${file}: ${issue.code} ${issue.pointer ?? ''} ${issue.message}`);
    ++found;
  }
}
process.exit(found === 0 ? 0 : 1);
