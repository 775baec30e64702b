#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a gtest binary and prints one line per test: ok, FAIL or SKIP.   run_gtest.py BINARY [GTEST_FILTER]"""
import json
import os
import subprocess
import sys
import tempfile

binary, chosen = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "*"
with tempfile.TemporaryDirectory() as folder:
    report = os.path.join(folder, "report.json")
    run = subprocess.run([binary, f"--gtest_filter={chosen}", f"--gtest_output=json:{report}"],
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", timeout=1800)
    suites = json.load(open(report))["testsuites"] if os.path.exists(report) else None
if suites is None:
    print(run.stdout[-6000:])
    print(f"FAIL unit: {binary} ended with {run.returncode} before its report")
    sys.exit(1)
tests = [t for s in suites for t in s["testsuite"] if t["status"] == "RUN"]
for t in tests:
    name = f'{t["classname"]}.{t["name"]}'
    if t.get("failures"):
        first = t["failures"][0]["failure"].strip().splitlines()
        print("\n".join(first[:12]))
        print(f"FAIL {name}: {first[0]}")
    elif t["result"] == "SKIPPED":
        why = " ".join(s.get("message", "").strip() for s in t.get("skipped", [])) or "skipped"
        print(f"SKIP {name}: {why.splitlines()[-1]}")
    else:
        print(f"ok {name}")
if not tests:
    print(f"FAIL unit: no test matches {chosen}")
sys.exit(1 if run.returncode or not tests else 0)
