#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The page's own checks: types and unit tests (viewer_client/web).
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../../viewer_client/web" || exit 1
status=0
[ -d node_modules ] || npm ci --no-audit --no-fund >/dev/null || status=1
if npm run --silent check; then echo "ok page.types"; else echo "FAIL page.types: tsc"; status=1; fi
report=$(mktemp)
npx vitest run --reporter=json --outputFile="$report" >/dev/null 2>&1
node -e '
  const report = JSON.parse(require("fs").readFileSync(process.argv[1], "utf8"));
  let bad = report.numTotalTests === 0;
  for (const file of report.testResults) for (const t of file.assertionResults) {
    if (t.status === "passed") console.log("ok page." + t.fullName);
    else if (t.status === "failed") { bad = true; console.log("FAIL page." + t.fullName + ": " + (t.failureMessages[0] ?? "").split("\n")[0]); }
    else console.log("SKIP page." + t.fullName + ": " + t.status);
  }
  process.exit(bad ? 1 : 0);' "$report" || status=1
rm -f "$report"
exit $status
