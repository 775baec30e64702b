#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The director's page in a real browser, against the programs in a build folder: tests/browser/run.sh build [run.mjs's options]
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$(cd "${1:?which build folder?}" && pwd)
shift
for program in node npm; do
  command -v $program >/dev/null || { echo "SKIP browser: $program is not installed (apt-get install nodejs npm)"; exit 0; }
done
[ -x "${CHROMIUM:-/usr/bin/chromium}" ] || { echo "SKIP browser: no chromium (apt-get install chromium, or set CHROMIUM)"; exit 0; }
for file in mixstage-server mixstage-agent page/index.html; do
  [ -e "$build/$file" ] || { echo "FAIL browser: $build/$file is missing; build it first"; exit 1; }
done
cd "$here"
# Packages are fetched once; a changed lock file fetches them again.
if ! cmp -s package-lock.json node_modules/.fetched; then
  npm ci --no-audit --no-fund --loglevel=error >&2
  cp package-lock.json node_modules/.fetched
fi
# Metres under the pointer are held against the synthetic room's exact depth: the wall beside the picture, the floor in front.
truth=$(mktemp)
trap 'rm -f "$truth"' EXIT
"$build/tests/synthetic_truth" 460 60 0.08 480 745 0.05 >"$truth"
node run.mjs --build "$build" --truth "$truth" "$@"
