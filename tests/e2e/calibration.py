#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`calibrate` on the shared test data: the studio's views scored against its true rig, and views that are no good.

calibration.py BUILD_DIR [OUT_DIR]      OUT_DIR keeps rigs and reports
"""
import json
import pathlib
import shutil
import sys
import time

from programs import DATA, PYTHON, ROOT, evaluate, folders, program, run_on_data

STUDIO = DATA / "studio_a"
BUILD, OUT = folders("calibration")


def calibrate(name, *views, expected=0, rig=None):
    out = OUT / name
    arguments = [a for v in views for a in ("--views", v)] + (["--rig", rig] if rig else [])
    run = program(BUILD / "mixstage-server", "--log-level", "error", "calibrate", *arguments, "--out", out, expect=expected)
    report = json.loads((out / "report.json").read_text()) if (out / "report.json").exists() else None
    return out, report, run.stderr


def over_their_deviations(report):
    """Errors over the deviations that the report states: of the colour camera's lens, the largest; of the range error at 1 to 5 m, the rms."""
    truth = json.loads((STUDIO / "ground_truth" / "rig.json").read_text())["cameras"]
    lens = max(abs(v["value"] - truth["color"][k]) / v["std"] for k, v in report["cameras"]["color"]["lens"].items())
    found, curve = report["range_error"], truth["depth"]["range_error"]
    squares = []
    for r, e, std in zip(found["range_m"], found["error_m"], found["std_m"]):
        if 1 <= r <= 5:
            i = min(range(len(curve["range_m"])), key=lambda k: abs(curve["range_m"][k] - r))  # both are tabulated in steps of 50 mm
            squares.append(((e - curve["error_m"][i]) / std) ** 2)
    return lens, (sum(squares) / len(squares)) ** 0.5


def subset(name, source, keep, lists=("rgb", "amplitude", "depth")):
    """A folder of views with the lines `keep` of another's lists."""
    folder = OUT / "views" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copy(STUDIO / source / "board.json", folder)
    for kind in lists:
        lines = [line for line in (STUDIO / source / f"{kind}.txt").read_text().splitlines() if not line.startswith("#")]
        (folder / f"{kind}.txt").write_text("".join(lines[i] + "\n" for i in keep))
        (folder / kind).mkdir()
        for i in keep:
            file = lines[i].split()[1]
            shutil.copy(STUDIO / source / file, folder / file)
    return folder


def the_studio_is_calibrated():
    start = time.monotonic()
    out, report, _ = calibrate("studio", STUDIO / "calib", STUDIO / "calib_wide", STUDIO / "handeye")
    seconds = time.monotonic() - start
    score = evaluate("evaluate_rig.py", out / "rig.json", STUDIO / "ground_truth" / "rig.json", "--max-angle-deg", 80)
    limits = [("color", "projection_mean_px", 0.1), ("depth", "projection_mean_px", 0.05), ("fisheye", "projection_mean_px", 0.15),
              ("T_color_depth", "transfer_mean_px", 0.15), ("T_color_depth", "distance_mm", 1.0), ("T_color_fisheye", "distance_mm", 2.0),
              # 0.12 is the goal; the set's fisheye pictures follow its model to 0.04 px only, six times as much in colour pixels.
              ("T_color_fisheye", "transfer_mean_px", 0.2), ("range_error_mm", "mean", 2.5)]
    found = ", ".join(f"{a}.{b} {score[a][b]:.3f}" for a, b, _ in limits)
    for a, b, limit in limits:
        assert score[a][b] <= limit, f"{a}.{b} {score[a][b]:.3f} > {limit} ({found})"
    head = program(PYTHON, ROOT / "tests" / "support" / "evaluate_head.py", out / "rig.json", STUDIO / "scan",
                   STUDIO / "ground_truth" / "poses" / "scan_groundtruth.txt")
    sweep = json.loads(head.stdout)
    # From a position to the next the goal is 0.03 deg and 1 mm; between any two the encoders' own noise is 0.019 deg.
    for pairs, deg, mm in (("consecutive", 0.03, 1.0), ("pairs", 0.04, 1.5)):
        a, b = sweep[pairs]["rotation_rms_deg"], sweep[pairs]["translation_rms_mm"]
        found += f", head {pairs} {a:.4f} deg {b:.2f} mm"
        assert a <= deg and b <= mm, found
    lens, curve = over_their_deviations(report)
    found += f", off by {lens:.1f} of the lens' deviations, {curve:.1f} of the range curve's"
    assert lens <= 2.5 and curve <= 1.5, found
    for name, camera in report["cameras"].items():
        assert camera["held_out"]["boards"] > 0 and camera["held_out"]["rms_px"] < 0.3, (name, camera["held_out"])
    assert (out / "report.html").read_text().count("<svg") >= 6
    return f"{found}; {seconds:.0f} s"


def pictures_that_are_no_good_are_named():
    folder = subset("damaged", "calib", range(10))
    whole = (folder / "rgb" / "0001.jpg").read_bytes()
    (folder / "rgb" / "0001.jpg").write_bytes(whole[: len(whole) // 2])
    plate = next(p for p in sorted((STUDIO / "scan" / "rgb").iterdir()))
    shutil.copy(plate, folder / "rgb" / "0002.jpg")  # no board in it
    shutil.copy(STUDIO / "calib" / "rgb" / "0015.jpg", folder / "rgb" / "0003.jpg")  # the board was carried on
    blurred = folder / "rgb" / "0006.jpg"
    program(PYTHON, "-c", "import cv2, sys; f = sys.argv[1]; cv2.imwrite(f, cv2.GaussianBlur(cv2.imread(f), (0, 0), 3))", blurred)
    out, report, _ = calibrate("damaged", folder, rig=STUDIO / "rig.json")
    why = {pathlib.Path(e["file"]).parent.name + "/" + pathlib.Path(e["file"]).name: e["why"] for e in report["left_out"]}
    assert "rgb/0001.jpg" in why, why
    assert "no whole board" in why.get("rgb/0002.jpg", ""), why
    assert "is blurred" in why.get("rgb/0006.jpg", ""), why
    assert any("px rms" in why.get(f"{kind}/0003.{end}", "") for kind, end in (("rgb", "jpg"), ("amplitude", "png"))), why
    assert (out / "rig.json").exists()
    return f"{len(why)} pictures left out by name"


def an_encoder_a_degree_off_is_named():
    folder = subset("encoder", "handeye", range(18))
    rows = [line.split() for line in (STUDIO / "handeye" / "ptu.txt").read_text().splitlines() if not line.startswith("#")]
    rows[4][1] = str(float(rows[4][1]) + 1)
    (folder / "ptu.txt").write_text("".join(" ".join(row) + "\n" for row in rows))
    _, report, _ = calibrate("encoder", STUDIO / "calib", folder, rig=STUDIO / "rig.json")
    why = {v["name"]: v.get("why", "") for v in report["hand_eye"]["views"] if not v["used"]}
    assert list(why) == ["encoder/0004"] and "pan encoder" in why["encoder/0004"], why
    return why["encoder/0004"]


def too_few_views_are_refused():
    out, report, stderr = calibrate("few", subset("few", "calib", range(3)), rig=STUDIO / "rig.json", expected=4)
    assert "too few views" in stderr and not report["good"], stderr
    assert not (out / "rig.json").exists()
    return report["failed_gates"][0]


def unusable_input_is_named():
    folder = subset("nan", "calib", range(3))
    (folder / "board.json").write_text('{"inner_corners": [9, 6], "square_m": NaN}')
    _, _, stderr = calibrate("nan", folder, rig=STUDIO / "rig.json", expected=3)
    assert "board.json" in stderr, stderr
    _, _, stderr = calibrate("missing", OUT / "not there", expected=3)
    assert "not there" in stderr, stderr
    return "exit 3 with the file's name"


TESTS = [the_studio_is_calibrated, pictures_that_are_no_good_are_named, an_encoder_a_degree_off_is_named,
         too_few_views_are_refused, unusable_input_is_named]

if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    sys.exit(1 if run_on_data(TESTS) else 0)
