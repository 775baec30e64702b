#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a gtest binary and prints one line per test: ok, FAIL or SKIP."""
import argparse
import json
import os
import subprocess
import sys
import tempfile

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("binary")
arguments.add_argument("filter", nargs="?", default="*", help="gtest filter")
arguments.add_argument("--shards", type=int, default=1, help="processes at a time that share the tests")
arguments.add_argument("--prefix", default="", help="in front of every test's name")
options = arguments.parse_args()
binary, prefix = options.binary, options.prefix


def start(shard, report, log):
    environment = dict(os.environ, GTEST_TOTAL_SHARDS=str(options.shards), GTEST_SHARD_INDEX=str(shard))
    return subprocess.Popen([binary, f"--gtest_filter={options.filter}", f"--gtest_output=json:{report}"], stdout=log,
                            stderr=subprocess.STDOUT, env=environment)


count = bad = 0
with tempfile.TemporaryDirectory() as folder:
    reports = [os.path.join(folder, f"{i}.json") for i in range(options.shards)]
    logs = [open(os.path.join(folder, f"{i}.log"), "w+b") for i in range(options.shards)]
    runs = [start(i, reports[i], logs[i]) for i in range(options.shards)]
    for run, report, log in zip(runs, reports, logs):
        ended = run.wait(timeout=3600)
        log.seek(0)
        output = log.read().decode(errors="replace")
        suites = json.load(open(report))["testsuites"] if os.path.exists(report) else None
        if suites is None:
            print(output[-6000:])
            print(f"FAIL {prefix}unit: {binary} ended with {ended} before its report")
            bad += 1
            continue
        tests = [t for s in suites for t in s["testsuite"] if t["status"] == "RUN"]
        count += len(tests)
        failures = 0
        for t in tests:
            name = f'{prefix}{t["classname"]}.{t["name"]}'
            if t.get("failures"):
                failures += 1
                first = t["failures"][0]["failure"].strip().splitlines()
                print("\n".join(first[:12]))
                print(f"FAIL {name}: {first[0]}")
            elif t["result"] == "SKIPPED":
                why = " ".join(s.get("message", "").strip() for s in t.get("skipped", [])) or "skipped"
                print(f"SKIP {name}: {why.splitlines()[-1]}")
            else:
                print(f"ok {name}")
        if ended and not failures:  # a sanitizer's report at the end, a crash on the way out
            print(output[-6000:])
            print(f"FAIL {prefix}unit: {binary} ended with {ended}")
        bad += ended != 0
if not count and not bad:
    print(f"FAIL {prefix}unit: no test matches {options.filter}")
sys.exit(1 if bad or not count else 0)
