#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The actor in another space (piVE 5) by real programs: the synthetic set is swept and scanned, then its actor is put elsewhere in
his own room, into a scanned room seen by another camera, and into a recording with depth.

avatar.py BUILD_DIR [OUT_DIR]      OUT_DIR keeps everything; a step that is done there is not done again
"""
import json
import os
import sys

import cv2
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from programs import DEMO, Studio, folders, program, run_all

BUILD, OUT = folders("avatar")
SERVER = BUILD / "mixstage-server"
RIG = DEMO / "rig.json"
BEGIN_S, END_S = 8.4, 8.9
LAST = 11  # the frame that is looked at


def take():
    folder = OUT / "take"
    if not folder.exists():
        program(BUILD / "tests" / "make_synthetic_take", folder, BEGIN_S, END_S)
    return folder


def room():
    folder = OUT / "room"
    if not folder.exists():
        if not (OUT / "sweep").exists():
            program(BUILD / "mixstage-agent", "--log-level", "warn", "--source", "synthetic", "--views", "scan", "--record", OUT / "sweep")
        program(SERVER, "--log-level", "error", "scan", "--views", OUT / "sweep", "--rig", RIG, "--out", folder)
    return folder


def scene(name, avatar):
    file = OUT / f"{name}.yaml"
    file.write_text("version: 1\n" + (f"avatar: {avatar}\n" if avatar else ""))
    return file


def process(name, avatar, scanned=True, expect=0):
    """The last frame's pictures by export, and the report; of a refusal its one line."""
    out = OUT / name
    run = program(SERVER, "--log-level", "error", "process", "--take", take(), *(["--environment", room()] if scanned else []), "--scene",
                  scene(name, avatar), "--out", out, "--export", "composite,depth,alpha,report", "--frames", f"0:{LAST + 1}", expect=expect)
    if expect:
        lines = [line for line in run.stderr.splitlines() if line.startswith("mixstage-server:")]
        assert len(lines) == 1, run.stderr
        return lines[0][len("mixstage-server: "):]
    read = {kind: cv2.imread(str(sorted((out / kind).glob("*.png"))[LAST]), cv2.IMREAD_UNCHANGED) for kind in ("composite", "depth", "alpha")}
    read["report"] = json.loads((out / "report.json").read_text())
    return read


def pose():
    """T_world_color of the take's camera: it stands."""
    process("pose", None)
    program(SERVER, "--log-level", "error", "process", "--take", take(), "--rig", RIG, "--out", OUT / "pose", "--export", "pose", "--frames", "0:1")
    _, tx, ty, tz, x, y, z, w = map(float, (OUT / "pose" / "pose.txt").read_text().splitlines()[-1].split())
    T = np.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = tx, ty, tz
    return T


def ahead(metres):
    """As far along the floor, away from the camera."""
    direction = pose()[:2, 2]
    return metres * direction / np.linalg.norm(direction)


def height(alpha):
    rows = np.flatnonzero((alpha >= 128).any(axis=1))
    return rows[-1] - rows[0] + 1


def who_is_put_where_he_stands_is_seen_as_he_is():
    plain, same = process("plain", None), process("same", "{}")
    his = plain["alpha"] == 255
    off = np.abs(plain["composite"].astype(int) - same["composite"]).max(axis=2)
    assert his.sum() > 5000 and np.mean(off[his] > 6) < 0.01, np.mean(off[his] > 6)
    assert np.mean(np.abs(plain["alpha"].astype(int) - same["alpha"])) < 0.2
    depth = np.abs(plain["depth"].astype(int) - same["depth"])[his]
    assert np.percentile(depth, 99) < 30, np.percentile(depth, 99)
    away = cv2.dilate((plain["alpha"] > 0).astype(np.uint8), np.ones((61, 61))) == 0  # his shadow goes too
    assert off[away].mean() < 2, off[away].mean()
    return f"{off[his].mean():.2f} grey levels inside him, {np.percentile(depth, 99):.0f} mm; place_avatar {same['report']['stages']['place_avatar']['cpu_ms']['p50']:.1f} core-ms"


def farther_away_he_is_smaller_and_his_place_is_empty():
    plain = process("plain", None)
    x, y = ahead(0.6)
    far = process("far", f"{{position: [{x:.4f}, {y:.4f}, 0]}}")
    z = np.median(plain["depth"][plain["alpha"] == 255]) / 1000
    ratio = height(far["alpha"]) / height(plain["alpha"])
    assert abs(ratio - z / (z + 0.6)) < 0.04, (ratio, z)
    moved = np.median(far["depth"][far["alpha"] == 255]) / 1000
    assert abs(moved - z - 0.6) < 0.08, (moved, z)  # what is seen goes with him
    left = (plain["alpha"] == 255) & (far["alpha"] == 0)
    plate = next(f for f in sorted((take() / "clean_plate" / "rgb").iterdir()))
    residual = np.abs(far["composite"].astype(int) - cv2.imread(str(plate)))[left].mean()
    assert left.sum() > 1000 and residual < 8, (left.sum(), residual)
    return f"height {ratio:.3f}, {moved - z:.3f} m farther, {residual:.1f} grey levels off the empty set"


def another_camera_sees_him_in_a_scanned_room():
    T = pose()
    at, to = T[:3, 3] + 0.4 * T[:3, 0] + 0.2 * T[:3, 2], T[:3, 3] + 4 * T[:3, 2]
    spots = [", ".join(f"{v:.4f}" for v in p) for p in (at, to)]
    avatar = f"{{room: room, camera: {{position: [{spots[0]}], look_at: [{spots[1]}]}}}}"
    first, again = process("room_seen", avatar, scanned=False), process("room_again", avatar, scanned=False)
    for kind in ("composite", "depth", "alpha"):
        assert (first[kind] == again[kind]).all(), f"{kind} differs from one run to the next"
    his = first["alpha"] == 255
    assert his.sum() > 5000, his.sum()
    # Taken to the world he is where he is for his own camera.
    f = json.loads(RIG.read_text())["cameras"]["color"]
    def middle(picture, pose_of):
        v, u = np.nonzero(picture["alpha"] == 255)
        z = picture["depth"][v, u] / 1000
        rays = cv2.undistortPoints(np.stack([u, v], 1).astype(float)[:, None], np.array([[f["fx"], 0, f["cx"]], [0, f["fy"], f["cy"]], [0, 0, 1]]),
                                   np.array([f.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]))[:, 0]
        return (np.c_[rays * z[:, None], z] @ pose_of[:3, :3].T + pose_of[:3, 3]).mean(axis=0)
    look = (to - at) / np.linalg.norm(to - at)
    right = np.cross(look, [0, 0, 1]) / np.linalg.norm(np.cross(look, [0, 0, 1]))
    view = np.eye(4)
    view[:3, :3] = np.stack([right, np.cross(look, right), look], axis=1)
    view[:3, 3] = at
    apart = np.linalg.norm(middle(first, view) - middle(process("plain", None), T))
    assert apart < 0.08, apart
    return f"{his.sum()} px, {1000 * apart:.0f} mm from where he is; place_avatar {first['report']['stages']['place_avatar']['cpu_ms']['p50']:.1f} core-ms"


def in_a_recording_he_is_hidden_by_who_is_nearer():
    """The same take as the background: its actor stands before the avatar that was put behind him."""
    plain = process("plain", None)
    x, y = ahead(0.8)
    behind = process("video", f"{{video: take, position: [{x:.4f}, {y:.4f}, 0]}}", scanned=False)
    far = process("video_aside", f"{{video: take, position: [{x + 0.5 * pose()[0, 0]:.4f}, {y + 0.5 * pose()[1, 0]:.4f}, 0]}}", scanned=False)
    seen, free = np.count_nonzero(behind["alpha"] >= 128), np.count_nonzero(far["alpha"] >= 128)
    assert free > 4000 and seen < 0.6 * free, (seen, free)
    inside = cv2.erode((plain["alpha"] == 255).astype(np.uint8), np.ones((15, 15))) > 0
    assert np.count_nonzero(behind["alpha"][inside]) < 0.05 * np.count_nonzero(inside), "he shines through the one before him"
    return f"{seen} of {free} px are left of him"


def what_cannot_be_is_said_in_a_line():
    said = [process("bad", "{room: nowhere}", scanned=False, expect=3), process("bad", "{video: nowhere}", scanned=False, expect=3),
            process("bad", "{}", scanned=False, expect=2), process("bad", "{turn_deg: .nan}", expect=2)]
    for line, word in zip(said, ("nowhere", "nowhere", "--environment", "avatar.turn_deg")):
        assert word in line, line
    return said[2][:60]


def a_live_show_has_him_too():
    with Studio(BUILD) as studio:
        studio.server("--environment", room(), scene=scene("live", "{position: [0.3, 0.3, 0], turn_deg: 5}"))
        studio.agent()
        studio.wait_until_live()
        seen = studio.view(3)
        assert seen["frames"] > 20, seen
        return f'{seen["frames"]} pictures in 3 s'


if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    sys.exit(1 if run_all([who_is_put_where_he_stands_is_seen_as_he_is, farther_away_he_is_smaller_and_his_place_is_empty,
                           another_camera_sees_him_in_a_scanned_room, in_a_recording_he_is_hidden_by_who_is_nearer,
                           what_cannot_be_is_said_in_a_line, a_live_show_has_him_too]) else 0)
