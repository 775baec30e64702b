#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs, builds and shows MixStage: an agent, the server and the page at the printed URL, until Ctrl-C.
#
#   deploy/demo.sh                     the synthetic room and figure: no camera, no download
#   deploy/demo.sh --take DIR          a recording (capture folder) instead, in a loop
#   deploy/demo.sh --take DIR --scene scene.yaml
#   deploy/demo.sh --seconds 30        for 30 s, watched by mixstage-view; its last line is JSON
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

seconds="" take="" scene=""
usage() { sed -n '3,10s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; }
while [ $# -gt 0 ]; do
  case $1 in
    --seconds) seconds=${2:?--seconds needs a number}; shift 2 ;;
    --take) take=${2:?--take needs a folder}; shift 2 ;;
    --scene) scene=${2:?--scene needs a file}; shift 2 ;;
    -h | --help) usage; exit 0 ;;
    *) echo "demo.sh: unknown option $1" >&2; usage >&2; exit 2 ;;
  esac
done
case $seconds in *[!0-9]*) echo "demo.sh: --seconds $seconds is not a whole number" >&2; exit 2 ;; esac
if [ -n "$take" ] && [ ! -f "$take/rgb.txt" ]; then
  echo "demo.sh: $take is no capture folder (rgb.txt is missing)" >&2
  exit 3
fi

"$root/deploy/install.sh" >&2
"$root/deploy/build.sh" >&2

# A port and an LCM channel of our own, so that two demonstrations do not meet.
free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }
port=8080
python3 -c 'import socket; socket.socket().bind(("127.0.0.1", 8080))' 2>/dev/null || port=$(free_port)
lcm="udpm://239.255.76.67:$(free_port)?ttl=0&recv_buf_size=4194304"

server=("$root/build/mixstage-server" --log-level warn run --listen "127.0.0.1:$port" --lcm "$lcm")
agent=("$root/build/mixstage-agent" --log-level warn --lcm "$lcm")
if [ -n "$take" ]; then
  server+=(--rig "$take")
  agent+=(--source "take:$take" --loop)
  [ -d "$take/clean_plate" ] && server+=(--clean-plate "$take/clean_plate")
else
  server+=(--rig "$root/deploy/demo/rig.json")
  agent+=(--source synthetic)
  # A copy: what a director saves must not change the demonstration.
  rm -rf "$root/build/demo" && cp -r "$root/deploy/demo" "$root/build/demo"
  scene=${scene:-$root/build/demo/scene.yaml}
fi
[ -n "$scene" ] && server+=(--scene "$scene")

started=()
stop() {
  for pid in "${started[@]}"; do kill -TERM "$pid" 2>/dev/null || true; done
  for pid in "${started[@]}"; do wait "$pid" 2>/dev/null || true; done
}
trap stop EXIT
trap 'exit 0' INT TERM

"${server[@]}" >&2 & started+=($!)
"${agent[@]}" >&2 & started+=($!)
url="http://127.0.0.1:$port/"
# Live: the agent's first pictures are there and the empty set is learnt. A person may watch that, a measurement waits.
wanted='"status"'
[ -n "$seconds" ] && wanted='"live"'
for _ in $(seq 300); do
  for pid in "${started[@]}"; do
    kill -0 "$pid" 2>/dev/null || { wait "$pid" && code=0 || code=$?; echo "demo.sh: a program has ended (exit code $code)" >&2; exit 1; }
  done
  python3 -c "import sys, urllib.request as u; sys.exit('$wanted' not in u.urlopen('${url}healthz', timeout=1).read().decode())" 2>/dev/null && break
  sleep 0.1
done
echo "MixStage is at $url  (Ctrl-C ends it)"
if [ -n "$seconds" ]; then
  "$root/build/mixstage-view" "$url" --seconds "$seconds"
else
  wait -n "${started[@]}" || true
  echo "demo.sh: a program has ended" >&2
  exit 1
fi
