#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs everything that MixStage is built, run and tested with on Debian 12. Unattended, repeatable; root or sudo.
#
#   deploy/install.sh
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

mapfile -t packages < <(grep -v '^#' "$here/packages.txt")
# Where Node.js does not come from Debian (it brings its own npm), Debian's npm package would fight it.
command -v npm >/dev/null || packages+=(npm)

missing=()
for package in "${packages[@]}"; do
  [ "$package" = nodejs ] && command -v node >/dev/null && continue
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
if [ ${#missing[@]} -gt 0 ]; then
  echo "installing ${#missing[@]} packages: ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi

# LCM's pictures come in bursts: room for them in the socket, as far as this machine lets us.
if [ "$(cat /proc/sys/net/core/rmem_max)" -lt 4194304 ]; then
  as_root sysctl -q -w net.core.rmem_max=4194304 2>/dev/null ||
    echo "note: net.core.rmem_max stays at $(cat /proc/sys/net/core/rmem_max); pictures may be lost in bursts"
fi
# A machine without any network has no route for multicast: the loopback serves.
if ! ip route get 239.255.76.67 >/dev/null 2>&1; then
  { as_root ip link set lo up && as_root ip link set lo multicast on && as_root ip route add 224.0.0.0/4 dev lo; } ||
    echo "note: multicast has no route; LCM needs one: ip route add 224.0.0.0/4 dev lo"
fi
echo "everything is installed"
