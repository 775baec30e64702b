#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs, builds and shows MixStage: an agent, the server and the page at the printed URL, until Ctrl-C.
#
#   deploy/demo.sh                     the synthetic rig: calibrated, its room scanned, then the show; no camera, no download
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

mixstage_server=("$root/build/mixstage-server" --log-level warn)
mixstage_agent=("$root/build/mixstage-agent" --log-level warn --lcm "$lcm")
server=("${mixstage_server[@]}" run --listen "127.0.0.1:$port" --lcm "$lcm")
agent=("${mixstage_agent[@]}")
started=()
stop() {
  for pid in "${started[@]}"; do kill -TERM "$pid" 2>/dev/null || true; done
  for pid in "${started[@]}"; do wait "$pid" 2>/dev/null || true; done
  started=()
}
trap stop EXIT
trap 'exit 0' INT TERM

# What an engineer does with a new rig, shortened: boards before the cameras, boards while the head turns, and a sweep of the
# middle of the room. Data sheets are all that is known before.
prepare_studio() {
  local studio=$1 since=$SECONDS
  echo "1 of 3: calibrating the rig from views of checkerboards" >&2
  for views in calibration hand-eye; do
    "${mixstage_agent[@]}" --source synthetic --views "$views" --record "$studio/$views" >&2
  done
  "${mixstage_server[@]}" calibrate --views "$studio/calibration" --views "$studio/hand-eye" \
    --rig "$root/deploy/demo/nominal.json" --out "$studio" >&2
  echo "2 of 3: scanning the empty room with the head ($((SECONDS - since)) s so far)" >&2
  "${mixstage_agent[@]}" --source synthetic:empty >&2 & started+=($!)
  "${mixstage_server[@]}" scan --live --lcm "$lcm" --rig "$studio/rig.json" --out "$studio/room" --pan -44:44 --tilt -25:25 >&2
  stop
  echo "3 of 3: the show ($((SECONDS - since)) s so far); reports: $studio/report.html, $studio/room/report.html" >&2
}
if [ -n "$take" ]; then
  server+=(--rig "$take")
  agent+=(--source "take:$take" --loop)
  [ -d "$take/clean_plate" ] && server+=(--clean-plate "$take/clean_plate")
else
  # A copy: what a director saves must not change the demonstration.
  rm -rf "$root/build/demo" && cp -r "$root/deploy/demo" "$root/build/demo"
  scene=${scene:-$root/build/demo/show.yaml}
  studio=$root/build/demo/studio
  mkdir "$studio"
  prepare_studio "$studio"
  server+=(--rig "$studio/rig.json" --environment "$studio/room")
  agent+=(--source synthetic)
fi
[ -n "$scene" ] && server+=(--scene "$scene")

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
