#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`process` on the recordings of the shared test data, scored by its evaluators; skipped where the data is missing.

recordings.py BUILD_DIR [OUT_DIR]      OUT_DIR keeps the pictures
"""
import json
import sys

from programs import DATA, evaluate, folders, program, run_on_data

BUILD, OUT = folders("recordings")
SERVER = BUILD / "mixstage-server"


def process(take, name, *more):
    out = OUT / name
    run = program(SERVER, "--log-level", "error", "process", "--take", take, "--out", out,
                  *([] if "--export" in more else ["--export", "composite,depth,alpha,label,cg_alpha,report"]), "--json", *more)
    return out, json.loads(run.stdout)


def still_scene(name):
    take = DATA / "real" / name
    out, report = process(take, name)
    score = evaluate("evaluate_static.py", out, take)
    assert score["still_flagged_percent"] <= 1.0, score
    assert score["changed_called_percent"] >= 85.0, score
    return f'still flagged {score["still_flagged_percent"]:.2f} %, changed called {score["changed_called_percent"]:.1f} %, {report["room"]}'


def people_are_keyed_and_the_room_is_not():
    return still_scene("rgbd_person")


def hands_over_a_desk_are_keyed_without_any_empty_frame():
    return still_scene("rgbd_desk")


def walkers_are_keyed_by_color_alone():
    take = DATA / "real" / "bgs_video"
    out = process(take, "bgs_video", "--export", "alpha")[0]
    score = evaluate("evaluate_bgs.py", out, take)
    assert score["F"] >= 0.89, score
    return f'F {score["F"]:.4f}'


def every_recording_plays():
    played = []
    for take in sorted(p.parent for p in (DATA / "real").glob("*/rgb.txt")) + sorted(p.parent for p in (DATA / "real").glob("*/*/rgb.txt")):
        if take.name == "clean_plate":
            continue
        report = process(take, f"plays/{take.name}")[1]
        assert report["frames"] > 0
        played.append(f'{take.name} {report["frames"]}')
    assert len(played) >= 5, played
    return ", ".join(played)


def the_actor_of_a_photoreal_studio_is_cut_out_and_occludes():
    studio = DATA / "studio_a"
    truth = studio / "ground_truth"
    out, report = process(studio / "take_static", "studio", "--rig", truth / "rig.json", "--scene", studio / "objects" / "scene_camera.yaml")
    matte = evaluate("evaluate_matte.py", out, truth / "matte_static", "--shadow", truth / "shadow_static")
    composite = evaluate("evaluate_composite.py", out, truth / "composite", truth / "cg_alpha", studio / "take_static" / "rgb")
    depth = evaluate("evaluate_depth.py", out / "depth", truth / "depth_static", "--mask", truth / "matte_static")
    assert matte["F"] >= 0.986 and matte["boundary_mean_px"] <= 1.0 and matte["MAD"] <= 0.047 and matte["dtSSD_x100"] <= 16, matte
    assert matte["shadow_as_actor"] <= 0.012 and matte["outside_permille"] <= 0.08, matte
    assert composite["order_error"] <= 0.02, composite
    return (f'F {matte["F"]:.4f}, boundary {matte["boundary_mean_px"]:.2f} px, MAD {matte["MAD"]:.3f}, dtSSD {matte["dtSSD_x100"]:.1f}, '
            f'order error {100 * composite["order_error"]:.2f} %, composite {composite["psnr_whole"]:.1f} dB, depth {depth}, {report["total"]["core_ms_per_frame"]:.1f} core-ms')


def a_scanned_room_is_keyed_against_without_a_clean_plate():
    studio = DATA / "studio_a"
    truth = studio / "ground_truth"
    room = OUT / "room"
    program(SERVER, "--log-level", "error", "scan", "--views", studio / "scan", "--rig", truth / "rig.json", "--out", room, "--json")
    check = program(SERVER, "check", "--environment", room)
    assert "good" in check.stdout, check
    # A copy without the clean plate: nothing else may be read.
    take = OUT / "take_without_plate"
    take.mkdir(exist_ok=True)
    for part in (studio / "take_static").iterdir():
        if part.name != "clean_plate" and not (take / part.name).exists():
            (take / part.name).symlink_to(part)
    out, report = process(take, "scanned", "--environment", room, "--scene", studio / "objects" / "scene.yaml",
                          "--export", "composite,alpha,label,cg_alpha,predicted,report")
    matte = evaluate("evaluate_matte.py", out, truth / "matte_static", "--shadow", truth / "shadow_static")
    composite = evaluate("evaluate_composite.py", out, truth / "composite", truth / "cg_alpha", studio / "take_static" / "rgb")
    empty = evaluate("evaluate_picture.py", out / "predicted_color" / "0000.png", truth / "empty_room.png")
    assert matte["F"] >= 0.985 and matte["boundary_mean_px"] <= 1.1 and matte["shadow_as_actor"] <= 0.012, matte
    assert composite["order_error"] <= 0.02, composite
    assert empty["psnr"] >= 30, empty
    moving, moving_report = process(studio / "take_moving", "scanned_moving", "--environment", room,
                                    "--export", "alpha,label,predicted,report")
    moving_matte = evaluate("evaluate_matte.py", moving, truth / "matte_moving", "--shadow", truth / "shadow_moving")
    moving_depth = evaluate("evaluate_depth.py", moving / "predicted_depth", truth / "depth_moving", "--mask", truth / "matte_moving", "--invert")
    assert moving_matte["F"] >= 0.985, moving_matte
    assert moving_depth["median_abs_mm"] <= 5, moving_depth
    return (f'F {matte["F"]:.4f}, boundary {matte["boundary_mean_px"]:.2f} px, order error {100 * composite["order_error"]:.2f} %, empty set '
            f'{empty["psnr"]:.1f} dB, {report["total"]["core_ms_per_frame"]:.1f} core-ms; camera moving: F {moving_matte["F"]:.4f}, D_M off by '
            f'{moving_depth["median_abs_mm"]:.0f} mm, {moving_report["total"]["core_ms_per_frame"]:.1f} core-ms')


def two_runs_give_the_same_bytes():
    take = DATA / "real" / "rgbd_desk"
    first = process(take, "first", "--frames", "0:6")[0]
    second = process(take, "second", "--frames", "0:6")[0]
    files = sorted(p.relative_to(first) for p in first.rglob("*.png"))
    assert len(files) == 30, len(files)
    for file in files:
        assert (first / file).read_bytes() == (second / file).read_bytes(), file


TESTS = [every_recording_plays, people_are_keyed_and_the_room_is_not, hands_over_a_desk_are_keyed_without_any_empty_frame,
         walkers_are_keyed_by_color_alone,
         the_actor_of_a_photoreal_studio_is_cut_out_and_occludes, a_scanned_room_is_keyed_against_without_a_clean_plate,
         two_runs_give_the_same_bytes]

if __name__ == "__main__":
    sys.exit(1 if run_on_data(TESTS) else 0)
