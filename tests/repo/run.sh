#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks of the repository itself: include order, formatting, no stray large or binary files.
set -uo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
status=0
check() {
  local name=$1 output
  shift
  if output=$("$@" 2>&1); then echo "ok repo.$name"; else
    echo "$output" | tail -n 20
    echo "FAIL repo.$name: see above"
    status=1
  fi
}
sources() { git ls-files '*.h' '*.cc'; }
formatted() { sources | xargs clang-format --dry-run -Werror; }
licensed() { ! sources | xargs grep -L 'SPDX-License-Identifier: Apache-2.0' | grep .; }
small() { ! git ls-files -z | xargs -0 -I{} find {} -size +2M | grep .; }
check include_order python3 tests/repo/include_order.py .
check one_definition python3 tests/repo/one_definition.py .
check formatted formatted
check licensed licensed
check small_files small
[ -d build ] && check client_package tests/repo/client_package.sh build
exit $status
