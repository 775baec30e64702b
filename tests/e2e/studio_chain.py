#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""From a box of cameras to a show: the synthetic rig is calibrated from its data sheets, scans its room by itself, and the
show is keyed against that room. Every step is held against the synthetic truth.

studio_chain.py BUILD_DIR [OUT_DIR]      OUT_DIR keeps everything; a step that is done there is not done again
"""
import json
import math
import sys

from programs import DEMO, Skip, Studio, evaluate, folders, program, run_all

BUILD, OUT = folders("chain")
TRUTH = DEMO / "rig.json"  # the rig that the synthetic set is seen by, never given to what is tested here
SERVER = BUILD / "mixstage-server"


def views(kind):
    folder = OUT / kind
    if not folder.exists():
        program(BUILD / "mixstage-agent", "--log-level", "warn", "--source", "synthetic", "--views", kind, "--record", folder)
    return folder


def calibrated():
    rig = OUT / "rig.json"
    if not rig.exists():
        program(SERVER, "--log-level", "warn", "calibrate", "--views", views("calibration"), "--views", views("hand-eye"),
                "--rig", DEMO / "nominal.json", "--out", OUT)
    return rig


def room():
    """A sweep by the agent's head over the middle of the room, scanned."""
    folder = OUT / "room"
    if not folder.exists():
        with Studio(BUILD) as studio:
            agent = studio.agent("synthetic:empty")
            program(SERVER, "--log-level", "warn", "scan", "--live", "--lcm", studio.lcm, "--rig", calibrated(), "--out", folder,
                    "--pan", "-44:44", "--tilt", "-25:25")
            assert agent.poll() is None, agent.stderr.read()
    return folder


def matrix(numbers):
    return [numbers[4 * i:4 * i + 4] for i in range(4)]


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def inverse(T):
    R = [[T[j][i] for j in range(3)] for i in range(3)]
    return [R[i] + [-sum(R[i][k] * T[k][3] for k in range(3))] for i in range(3)] + [[0, 0, 0, 1]]


def about(axis, angle_deg):
    length = math.hypot(*axis["direction"])
    x, y, z = (d / length for d in axis["direction"])
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    R = [[c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
         [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
         [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)]]
    p = axis["point"]
    return [R[i] + [p[i] - sum(R[i][k] * p[k] for k in range(3))] for i in range(3)] + [[0, 0, 0, 1]]


def pose(rig, pan_deg, tilt_deg):
    ptu, encoder = rig["ptu"], rig["ptu"].get("encoder", {})
    pan = encoder.get("pan_scale", 1) * pan_deg + encoder.get("pan_offset_deg", 0)
    tilt = encoder.get("tilt_scale", 1) * tilt_deg + encoder.get("tilt_offset_deg", 0)
    return product(product(product(matrix(ptu["T_world_base"]), about(ptu["pan_axis"], pan)), about(ptu["tilt_axis"], tilt)),
                   matrix(ptu["T_tilt_color"]))


def head_errors(rig, truth):
    """Root mean squares of angle (deg) and distance (mm) of poses relative to rest, over a sweep."""
    squares = []
    for pan in (-34, -11, 11, 34):
        for tilt in (-25, -8, 8, 25):
            moved = [product(inverse(pose(r, 0, 0)), pose(r, pan, tilt)) for r in (rig, truth)]
            D = product(inverse(moved[1]), moved[0])
            sine = math.hypot(D[2][1] - D[1][2], D[0][2] - D[2][0], D[1][0] - D[0][1])
            angle = math.degrees(math.atan2(sine, D[0][0] + D[1][1] + D[2][2] - 1))
            squares.append((angle ** 2, sum((1000 * D[i][3]) ** 2 for i in range(3))))
    return tuple(math.sqrt(sum(s[i] for s in squares) / len(squares)) for i in range(2))


def the_cameras_are_calibrated():
    score = evaluate("evaluate_rig.py", calibrated(), TRUTH, "--max-angle-deg", 80)
    for camera, most_px in (("color", 0.1), ("depth", 0.05), ("fisheye", 0.15)):
        assert score[camera]["projection_mean_px"] <= most_px, score
    assert score["T_color_depth"]["distance_mm"] <= 1 and score["T_color_fisheye"]["distance_mm"] <= 2, score
    assert score["T_color_depth"]["transfer_mean_px"] <= 0.15 and score["T_color_fisheye"]["transfer_mean_px"] <= 0.12, score
    assert score["range_error_mm"]["mean"] <= 2, score
    return (f'projection {score["color"]["projection_mean_px"]:.3f}, {score["depth"]["projection_mean_px"]:.3f}, '
            f'{score["fisheye"]["projection_mean_px"]:.3f} px, transfer {score["T_color_depth"]["transfer_mean_px"]:.3f}, '
            f'{score["T_color_fisheye"]["transfer_mean_px"]:.3f} px, range {score["range_error_mm"]["mean"]:.1f} mm')


def the_heads_axes_are_found():
    angle_deg, distance_mm = head_errors(json.loads(calibrated().read_text()), json.loads(TRUTH.read_text()))
    assert angle_deg <= 0.03 and distance_mm <= 1, f"{angle_deg:.3f} deg, {distance_mm:.2f} mm"
    return f"{angle_deg:.3f} deg, {distance_mm:.2f} mm rms"


def the_head_scans_its_room():
    report = json.loads((room() / "report.json").read_text())
    assert not report["left_out"], report["left_out"]
    assert report["coverage"] >= 0.99 and report["triangles"] <= 150_000, report
    return f'{len(report["views"])} views, coverage {report["coverage"]:.3f}, {report["triangles"]} triangles'


def the_room_is_where_it_is():
    """What the room predicts for the camera at rest, against the exact depth of the empty set (the window's glass too, which
    gives a time-of-flight camera little light)."""
    if "--environment" not in program(SERVER, "process", "--help").stdout:
        raise Skip("process knows no --environment")
    take = OUT / "take"
    if not take.exists():
        program(BUILD / "tests" / "make_synthetic_take", take, 0, 0.5)
    program(SERVER, "--log-level", "error", "process", "--take", take, "--rig", calibrated(), "--environment", room(), "--out", OUT / "process",
            "--export", "predicted,report", "--json")
    score = evaluate("evaluate_depth.py", OUT / "process" / "predicted_depth", take / "truth" / "depth")
    assert score["median_abs_mm"] <= 3 and score["p95_abs_mm"] <= 100 and score["completeness"] >= 0.97, score
    return f'median {score["median_abs_mm"]:.1f} mm, p95 {score["p95_abs_mm"]:.1f} mm, complete {score["completeness"]:.3f}'


if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    sys.exit(1 if run_all([the_cameras_are_calibrated, the_heads_axes_are_found, the_head_scans_its_room, the_room_is_where_it_is]) else 0)
