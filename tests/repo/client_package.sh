#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the C++ client library to an empty folder; a stranger's project of ten lines finds, links and runs it, and
# every installed header compiles alone.
#
#   client_package.sh [BUILD_DIR]
set -euo pipefail
build=$(realpath "${1:-build}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$build" --prefix "$work/installed" --component client >"$work/log"

mkdir "$work/project"
cat >"$work/project/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.25)
project(consumer CXX)
find_package(MixStageClient 0.1 REQUIRED)
file(GLOB sources *.cc)
add_executable(consumer ${sources})
target_link_libraries(consumer PRIVATE MixStage::client)
END
cat >"$work/project/main.cc" <<'END'
#include <thread>
#include "viewer_client/native/watch_client.h"
int main() {
  int vain = 0;
  std::stop_source stop;
  auto client = mixstage::WatchClient::Create(
      {.url = "http://127.0.0.1:1/"}, {.on_color = [](const mixstage::ColorPicture& p, const auto&) { mixstage::ToBgr(p.image); },
                                       .on_disconnected = [&](const std::string&) { ++vain, stop.request_stop(); }});
  return client && (*client)->Run(stop.get_token()) == mixstage::WatchEnd::kStopped && vain == 1 ? 0 : 1;
}
END
# One file for all headers, each first in its turn, is not the same as each alone; a file each is.
(cd "$work/installed/include/mixstage" && find . -name '*.h') | while read -r header; do
  name=$(echo "${header#./}" | tr / _)
  printf '#include "%s"\n' "${header#./}" >"$work/project/$name.cc"
done
cmake -S "$work/project" -B "$work/build" -G Ninja -DCMAKE_PREFIX_PATH="$work/installed" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
cmake --build "$work/build" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
"$work/build/consumer"
