#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Garbage and hold-out regions of the room by real programs, offline and live, held against the synthetic set's exact truth.

regions.py BUILD_DIR [OUT_DIR]      OUT_DIR keeps the pictures
"""
import json
import os
import sys

import cv2
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from programs import Studio, folders, program, run_all

BUILD, OUT = folders("regions")
FRAME = "0010"  # the take's truth has every tenth picture; the figure stands about 2.6 m away


def take():
    folder = OUT / "take"
    if not folder.exists():
        program(BUILD / "tests" / "make_synthetic_take", folder, 13.7, 14.4)
    return folder


def picture(file):
    return cv2.imread(str(file), cv2.IMREAD_UNCHANGED)


def regions(name, text):
    file = OUT / f"{name}.yaml"
    file.write_text(text)
    return file


def behind(from_m):
    return regions(f"behind_{from_m}", f"frame: camera\nregions: [{{name: back, kind: garbage, planes: [[0, 0, 1, -{from_m}]]}}]\n")


def process(name, *more):
    program(BUILD / "mixstage-server", "--log-level", "error", "process", "--take", take(), "--out", OUT / name, "--export", "alpha,label,depth",
            "--frames", "0:11", *more)
    return {kind: picture(OUT / name / kind / f"{FRAME}.png") for kind in ("alpha", "label", "depth")}


def garbage_ends_before_the_actor_or_behind_him():
    plain = process("plain")
    before = process("before", "--regions", behind(2))
    after = process("after", "--regions", behind(6))
    assert (before["alpha"] == 0).all() and (before["label"] != 1).all()
    changed = np.mean((plain["alpha"] >= 128) != (after["alpha"] >= 128)) * plain["alpha"].size / np.sum(plain["alpha"] >= 128)
    assert changed < 0.005, changed
    return f"{100 * changed:.2f} % of him changed by garbage 3 m behind him"


def a_box_of_the_world_holds_the_room_out():
    """What the empty room's true depth has inside of a box, by the take's true pose."""
    line = next(l for l in (take() / "truth/groundtruth.txt").read_text().splitlines() if not l.startswith("#"))
    t, (x, y, z, w) = np.array(line.split()[1:4], float), map(float, line.split()[4:8])
    R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    center, half_m = t + R @ [-0.7, 0.55, 3.4], 0.5
    file = regions("held", f"version: 1\nregions: [{{name: there, kind: hold_out, box: {{center: {[float(c) for c in center]}, size: [1, 1, 1]}}}}]\n")
    held = process("held", "--regions", file)
    camera = json.loads((take() / "rig.json").read_text())["cameras"]["color"]
    K = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    v, u = np.mgrid[:768, :1024]
    lens = np.array([camera.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3")])
    rays = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2).astype(float), K, lens).reshape(768, 1024, 2)
    depth_m = picture(take() / "truth/depth" / f"{FRAME}.png") / 1000.0
    empty = picture(take() / "truth/matte" / f"{FRAME}.png") == 0
    p = np.concatenate([rays, np.ones((768, 1024, 1))], -1) * depth_m[..., None] @ R.T + t
    inside = (np.abs(p - center) <= half_m).all(-1)
    out = (np.abs(p - center) > half_m + 0.15).any(-1)
    surely = cv2.erode(inside.astype(np.uint8), np.ones((15, 15))) > 0
    assert (surely & empty).sum() > 2000, surely.sum()
    hit, wrong = np.mean(held["alpha"][surely & empty] == 255), np.mean(held["alpha"][out & (cv2.dilate((~empty).astype(np.uint8), np.ones((25, 25))) == 0)] > 0)
    off_m = np.median(np.abs(held["depth"][surely & empty] / 1000.0 - depth_m[surely & empty]))
    assert hit > 0.95 and wrong < 0.005 and off_m < 0.05, (hit, wrong, off_m)
    return f"{100 * hit:.1f} % of what lies in the box kept, {100 * wrong:.2f} % of the rest, depth off by {1000 * off_m:.0f} mm"


def garbage_is_nobody_in_a_show():
    truth_mm = picture(take() / "truth/depth" / f"{FRAME}.png")
    him = cv2.erode(picture(take() / "truth/matte" / f"{FRAME}.png"), np.ones((41, 41))) == 255
    gone = {}
    for from_m in (6, 2):
        with Studio(BUILD) as studio:
            studio.server("--clean-plate", take() / "clean_plate", "--regions", behind(from_m), rig=take(), scene=None)
            studio.agent(f"take:{take()}", "--loop")
            studio.wait_until_live()
            dump = OUT / f"dump_{from_m}"
            studio.view(2, "--dump", dump)
        shown_mm = picture(sorted((dump / "depth").glob("*.png"))[-1])
        gone[from_m] = float(np.mean((shown_mm[him] == 0) | (shown_mm[him] > truth_mm[him] + 500.0)))
    assert gone[6] < 0.05 and gone[2] > 0.99, gone
    return f"beyond 6 m: {100 * gone[6]:.1f} % of him is the room, beyond 2 m: {100 * gone[2]:.1f} %"


TESTS = [garbage_ends_before_the_actor_or_behind_him, a_box_of_the_world_holds_the_room_out, garbage_is_nobody_in_a_show]

if __name__ == "__main__":
    sys.exit(1 if run_all(TESTS) else 0)
