#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Scans of recorded and rendered sweeps, beside their truth, and sweeps that no good scan can be made of.

scan.py BUILD_DIR [OUT_DIR]
"""
import json
import math
import re
import shutil
import sys

from programs import DATA, PYTHON, ROOT, evaluate, folders, program, run_on_data

BUILD, OUT = folders("scan")
SERVER = BUILD / "mixstage-server"
STUDIO = DATA / "studio_a"
TRUE_RIG = STUDIO / "ground_truth" / "rig.json"


def scan(views, rig, name, expect):
    return program(SERVER, "--log-level", "error", "scan", "--views", views, "--out", OUT / name, "--json", *(["--rig", rig] if rig else []),
                   expect=expect)


def scanned(views, rig, name):
    return OUT / name, json.loads(scan(views, rig, name, 0).stdout)


def read_poses(file):
    """Timestamped 4x4 T_world_color of TUM lines, as nested lists."""
    poses = []
    for line in file.read_text().splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        _, tx, ty, tz, x, y, z, w = map(float, line.split())
        poses.append([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), tx],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), ty],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), tz], [0, 0, 0, 1]])
    return poses


def relative(a, b):
    """a^-1 b of rigid 4x4."""
    R = [[sum(a[k][i] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    t = [sum(a[k][i] * (b[k][3] - a[k][3]) for k in range(3)) for i in range(3)]
    return [R[i] + [t[i]] for i in range(3)] + [[0, 0, 0, 1]]


def turn_deg(R):
    s = math.sqrt((R[2][1] - R[1][2]) ** 2 + (R[0][2] - R[2][0]) ** 2 + (R[1][0] - R[0][1]) ** 2)
    return math.degrees(math.atan2(s, R[0][0] + R[1][1] + R[2][2] - 1))


def rms(values):
    return (sum(v * v for v in values) / len(values)) ** 0.5


def pose_errors(environment, truth):
    """Rms over all pairs of views: degrees, millimetres."""
    frames = {int(f["name"]): [f["T_world_color"][4 * k:4 * k + 4] for k in range(4)] for f in environment["frames"]}
    turns, shifts = [], []
    for i in frames:
        for j in frames:
            if i < j:
                off = relative(relative(truth[i], truth[j]), relative(frames[i], frames[j]))
                turns.append(turn_deg(off))
                shifts.append(1000 * sum(off[k][3] ** 2 for k in range(3)) ** 0.5)
    return rms(turns), rms(shifts)


def a_photoreal_studio_is_scanned_to_millimetres():
    out, report = scanned(STUDIO / "scan", TRUE_RIG, "studio")
    environment = json.loads((out / "environment.json").read_text())
    turn, shift = pose_errors(environment, read_poses(STUDIO / "ground_truth" / "poses" / "scan_groundtruth.txt"))
    assert turn <= 0.02 and shift <= 1.0, (turn, shift)
    assert report["coverage"] >= 0.99 and report["triangles"] <= 150_000, report
    assert not report["left_out"], report["left_out"]
    floor = [p for p in environment["planes"] if p["kind"] == "floor"]
    assert len(floor) == 1 and abs(floor[0]["d"]) < 0.003 and floor[0]["n"][2] > 0.9999, floor
    for wall in ((-1, 0, 0, 7.0), (0, -1, 0, 6.0), (0, 1, 0, 0.0), (0, 0, -1, 3.0)):
        assert any(sum(a * b for a, b in zip(p["n"], wall)) > 0.9999 and abs(p["d"] - wall[3]) < 0.008 for p in environment["planes"]), wall
    program(SERVER, "--log-level", "error", "process", "--take", STUDIO / "take_static", "--environment", out, "--out", OUT / "empty",
            "--frames", "0:1", "--export", "predicted,report", "--json")
    for folder in ("predicted_depth", "predicted_color"):
        file = next((OUT / "empty" / folder).glob("*.png"))
        file.rename(file.with_stem("empty" if folder == "predicted_depth" else "empty_room"))
    depth = evaluate("evaluate_depth.py", OUT / "empty" / "predicted_depth", STUDIO / "ground_truth" / "depth_empty")
    edges = json.loads(program(PYTHON, ROOT / "tests" / "support" / "evaluate_edges.py", OUT / "empty" / "predicted_depth" / "empty.png",
                               STUDIO / "ground_truth" / "depth_empty" / "empty.png").stdout)
    picture = evaluate("evaluate_picture.py", OUT / "empty" / "predicted_color" / "empty_room.png", STUDIO / "ground_truth" / "empty_room.png")
    assert depth["median_abs_mm"] <= 3 and depth["p95_abs_mm"] <= 25 and depth["rms_mm"] <= 15 and depth["completeness"] >= 0.99, depth
    assert edges["median_px"] <= 2, edges
    assert picture["psnr"] >= 30, picture
    truth = STUDIO / "ground_truth"
    seams = json.loads(program(PYTHON, ROOT / "tests" / "support" / "evaluate_seams.py", OUT / "empty" / "predicted_color" / "empty_room.png",
                               truth / "empty_room.png", truth / "depth_empty" / "empty.png", out, TRUE_RIG,
                               truth / "poses" / "take_static_groundtruth.txt").stdout)
    assert seams["pixels"] > 1000 and seams["p95"] <= 1.5, seams
    return (f'poses {turn:.4f} deg {shift:.2f} mm, depth median {depth["median_abs_mm"]:.1f} p95 {depth["p95_abs_mm"]:.1f} rms {depth["rms_mm"]:.1f} mm, '
            f'edges {edges["median_px"]:.0f} px median, '
            f'colour {picture["psnr"]:.1f} dB, seams {seams["mean"]:.1f} p95 {seams["p95"]:.1f} levels, '
            f'{report["triangles"]} triangles, {report["total_ms"] / 1000:.1f} s')


def copy_of_the_sweep(name):
    folder = OUT / "input" / name
    shutil.copytree(STUDIO / "scan", folder, ignore=shutil.ignore_patterns("fisheye*"))
    return folder


def a_view_whose_encoder_is_a_degree_off_is_placed_by_its_pictures():
    views = copy_of_the_sweep("degree")
    lines = (views / "ptu.txt").read_text().splitlines()
    t, pan, tilt = lines[13].split()  # view 12
    lines[13] = f"{t} {float(pan) + 1.0:.4f} {tilt}"
    (views / "ptu.txt").write_text("\n".join(lines) + "\n")
    out, report = scanned(views, TRUE_RIG, "degree")
    told = [n for n in report["notes"] + report["left_out"] if n["view"] == "0012"]
    assert told, "nobody was told"
    turn, shift = pose_errors(json.loads((out / "environment.json").read_text()), read_poses(STUDIO / "ground_truth" / "poses" / "scan_groundtruth.txt"))
    assert turn <= 0.02 and shift <= 1.0, (turn, shift)
    return f'{told[0]["reason"]}; poses {turn:.4f} deg {shift:.2f} mm'


def poses_out_of_step_with_the_pictures_are_named():
    """Every view has the angles of the one before it."""
    views = copy_of_the_sweep("late")
    rows = [line.split() for line in (views / "ptu.txt").read_text().splitlines() if not line.startswith("#")]
    late = [[row[0], *rows[max(0, i - 1)][1:]] for i, row in enumerate(rows)]
    (views / "ptu.txt").write_text("".join(" ".join(row) + "\n" for row in late))
    stderr = scan(views, TRUE_RIG, "late", 4).stderr
    assert "out of step" in stderr and "1 view too late" in stderr, stderr
    return stderr.strip().splitlines()[-1][-90:]


def damaged_pictures_are_left_out_by_name():
    views = copy_of_the_sweep("damaged")
    for name, keep in (("rgb/0003.jpg", 4000), ("depth/0017_1.png", 2000)):
        file = views / name
        file.write_bytes(file.read_bytes()[:keep])
    report = scanned(views, TRUE_RIG, "damaged")[1]
    told = {n["view"] for n in report["left_out"]}
    assert told == {"0003", "0017"}, report["left_out"]
    return "; ".join(n["reason"] for n in report["left_out"])


def a_mirror_and_a_window_are_named():
    """A mirror of 1.4 x 1.2 m is hung beside the far corner; the studio's window has four panes that give no range."""
    views = copy_of_the_sweep("mirror")
    program(PYTHON, ROOT / "tests" / "support" / "hang_a_mirror.py", views, TRUE_RIG, STUDIO / "ground_truth" / "poses" / "scan_groundtruth.txt",
            "y=0", "5.2,0,1.0", "6.6,0,2.2", "7,6,3")
    warnings = scanned(views, TRUE_RIG, "mirror")[1]["warnings"]
    mirrors = [w for w in warnings if "has a mirror of 1." in w]
    panes = [w for w in warnings if "gave no range" in w]
    assert len(mirrors) == 1 and re.search(r" at 5\.[89]\d, -?0\.0\d, 1\.[56]", mirrors[0]), warnings
    assert len(panes) == 4, warnings
    return mirrors[0].split(";")[0]


def a_sweep_without_what_a_scan_needs_is_refused_in_one_line():
    said = []
    for views, rig, word in ((STUDIO / "scan", STUDIO / "rig.json", "ptu"), (DATA / "real" / "calib_stereo", None, ""), (STUDIO / "calib_wide", TRUE_RIG, "")):
        run = scan(views, rig, "refused", (3, 4))
        lines = [line for line in run.stderr.splitlines() if line.startswith("mixstage-server:")]
        assert len(lines) == 1 and word in lines[0], run.stderr
        said.append(lines[0][len("mixstage-server: "):][:90])
    return "; ".join(said)


def a_hand_held_sequence_with_poses_is_scanned():
    out, report = scanned(DATA / "real" / "room_scan", None, "kitchen")
    assert report["coverage"] >= 0.95 and report["triangles"] > 1000, report
    return f'coverage {report["coverage"]:.3f}, {report["triangles"]} triangles, {report["planes"]} planes, {report["total_ms"] / 1000:.1f} s'


TESTS = [a_photoreal_studio_is_scanned_to_millimetres, a_view_whose_encoder_is_a_degree_off_is_placed_by_its_pictures,
         poses_out_of_step_with_the_pictures_are_named, damaged_pictures_are_left_out_by_name, a_mirror_and_a_window_are_named, a_sweep_without_what_a_scan_needs_is_refused_in_one_line,
         a_hand_held_sequence_with_poses_is_scanned]

if __name__ == "__main__":
    sys.exit(1 if run_on_data(TESTS) else 0)
