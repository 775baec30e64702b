#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The show as a whole: `process` in core-ms per frame (with and without the delivery encoders), then live, seen by mixstage-view.

bench_show.py BUILD_DIR [--take DIR] [--rig FILE] [--scene FILE] [--seconds 60]

Without --take the synthetic set is used (written to a temporary folder first).
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
from programs import DEMO, Studio, resident_mb

ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
ap.add_argument("build"), ap.add_argument("--take"), ap.add_argument("--rig"), ap.add_argument("--scene")
ap.add_argument("--seconds", type=int, default=60)
a = ap.parse_args()
build = pathlib.Path(a.build).resolve()


def cpu_s(process):
    fields = open(f"/proc/{process.pid}/stat").read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


with tempfile.TemporaryDirectory() as folder:
    take, scene = a.take, a.scene
    if not take:
        take, scene = folder + "/take", scene or str(DEMO / "scene.yaml")
        subprocess.run([str(build / "tests/make_synthetic_take"), take, "4", "10"], check=True)
    for name, more in (("process", []), ("process --encode", ["--encode"])):
        command = [str(build / "mixstage-server"), "--log-level", "error", "process", "--take", take, "--out", folder + "/out",
                   "--export", "report", "--json", *more]
        command += ["--rig", a.rig] if a.rig else []
        command += ["--scene", scene] if scene else []
        runs = [json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout) for _ in range(3)]
        runs.sort(key=lambda r: r["total"]["core_ms_per_frame"])
        print(f'{name:18} {runs[1]["total"]["core_ms_per_frame"]:6.1f} core-ms per frame (median of 3)')
        for stage, times in runs[1]["stages"].items():
            print(f'  {stage:16} {times["cpu_ms"]["mean"]:6.2f}  budget {times["budget_ms"]}')
    with Studio(build) as studio:
        server = studio.server()
        agent = studio.agent()
        studio.wait_until_live()
        before = cpu_s(server), cpu_s(agent), time.monotonic()
        seen = studio.view(a.seconds)
        wall = time.monotonic() - before[2]
        print("live", json.dumps(seen))
        for who, process, start in (("server", server, before[0]), ("agent", agent, before[1])):
            print(f"  {who}: {1000 * (cpu_s(process) - start) / (wall * 30):.1f} core-ms per frame, {resident_mb(process):.0f} MB")
        print("  drops:", {k: v for k, v in studio.metrics().items() if "drops" in k})
