#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Composites against path-traced pictures of the set with the objects really in it (tools/evaluate_composite.py): our light map with the lamps that
the scan found and with those of scene_lit.yaml, beside no light map and MixIn3D's own method (every shadow drawn, also where one lies already;
one Gaussian blur). The baselines keep our CG pixels, which flatters them.

bench_composite.py BUILD_DIR [--data DIR] [--environment DIR] [--pictures DIR]

--data         the set (objects/, scan/, take_static/, ground_truth/); default ../shared/data/studio_a
--environment  a scan of it; without one the sweep is scanned first
--pictures     where truth, ours and the two baselines are kept side by side
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import cv2
import numpy as np
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[2]
ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
ap.add_argument("build"), ap.add_argument("--environment"), ap.add_argument("--pictures")
ap.add_argument("--data", default=str(ROOT.parent / "shared/data/studio_a"))
a = ap.parse_args()
server = pathlib.Path(a.build).resolve() / "mixstage-server"
data, truth = pathlib.Path(a.data), pathlib.Path(a.data) / "ground_truth"
BLUR_PX = 5
TARGETS = {"order_error": "<= 0.005", "shadow_iou": ">= 0.75", "psnr_touched": ">= 29", "psnr_rest": ">= 38", "psnr_cg": ">= 24", "psnr_whole": ">= 35"}


def run(*command):
    subprocess.run([str(server), "--log-level", "error", *map(str, command)], check=True, stdout=subprocess.DEVNULL)


def score(out):
    tool = ROOT.parent / "shared/tools/evaluate_composite.py"
    command = [sys.executable, tool, out, truth / "composite", truth / "cg_alpha", data / "take_static/rgb", "--json"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def linear(code):
    s = code.astype(np.float32) / 255
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def code(light):
    light = np.clip(light, 0, 1)
    return np.round(255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)).astype(np.uint8)


def points_of(depth_mm, camera, T_world_color):
    v, u = np.mgrid[: depth_mm.shape[0], : depth_mm.shape[1]]
    K = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1.0]])
    lens = np.array([camera.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3")])
    rays = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2).astype(np.float64), K, lens).reshape(*depth_mm.shape, 2)
    z = depth_mm[..., None] / 1000.0
    p = np.concatenate([rays * z, z], -1)
    return p @ T_world_color[:3, :3].T + T_world_color[:3, 3]


def shadow(p, casters, lamp, size=512, bias=0.05):
    """0 where a caster's point lies between p and the lamp: a shadow map of splats."""
    middle = casters.mean(0) - lamp
    z = middle / np.linalg.norm(middle)
    x = np.cross(z, [0, 0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0, 0])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    place = lambda q: (q - lamp) @ R.T
    c = place(casters)
    focal = 0.45 * size / np.abs(c[:, :2] / c[:, 2:]).max()
    pixel = lambda q: np.round(focal * q[..., :2] / np.maximum(q[..., 2:], 1e-3) + size / 2).astype(int)
    nearest = np.full((size, size), np.inf)
    at = pixel(c)
    np.minimum.at(nearest, (at[:, 1], at[:, 0]), c[:, 2])
    nearest = cv2.erode(nearest.astype(np.float32), np.ones((3, 3)))
    q = place(p)
    at = pixel(q)
    inside = (q[..., 2] > 0) & ((at >= 0) & (at < size)).all(-1)
    at = np.clip(at, 0, size - 1)
    return np.where(inside & (nearest[at[..., 1], at[..., 0]] < q[..., 2] - bias), 0.0, 1.0)


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    room = a.environment
    if not room:
        room = folder / "room"
        run("scan", "--views", data / "scan", "--rig", truth / "rig.json", "--out", room)
    stems = sorted(f.stem for f in (truth / "composite").iterdir() if f.suffix in (".jpg", ".png"))
    numbers = [int(s) for s in stems]
    results, cost = {}, {}
    for name, scene in (("lamps of the scan", "scene.yaml"), ("lamps given", "scene_lit.yaml")):
        out = folder / scene
        run("process", "--take", data / "take_static", "--rig", truth / "rig.json", "--environment", room, "--scene", data / "objects" / scene,
            "--out", out, "--export", "composite,cg_alpha,depth,alpha,pose", "--frames", f"{min(numbers)}:{max(numbers) + 1}")
        results[name] = score(out)
        stages = json.loads((out / "report.json").read_text())["stages"]
        cost[name] = {k: stages[k]["cpu_ms"]["p50"] for k in ("render_scene", "light_map", "z_key")}

    ours = folder / "scene_lit.yaml"
    rgb = {f.stem: f for f in (data / "take_static/rgb").iterdir()}
    camera = json.loads((truth / "rig.json").read_text())["cameras"]["color"]
    pose = np.loadtxt(ours / "pose.txt")[0]
    x, y, z, w = pose[4:8]
    T = np.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = pose[1:4]
    lamps = yaml.safe_load((data / "objects/scene_lit.yaml").read_text())["lights"]
    for stem in stems:
        read = lambda kind, flag: cv2.imread(str(ours / kind / (stem + ".png")), flag)
        made, cg, alpha, depth = read("composite", 1), read("cg_alpha", 0), read("alpha", 0), read("depth", -1)
        real = cv2.imread(str(rgb[stem]))
        p = points_of(depth, camera, T)
        # What casts: everything but the room, as the camera sees it.
        casters = p[((cg > 128) | (alpha > 128)) & (depth > 0)]
        normal = np.cross(np.gradient(p, axis=1), np.gradient(p, axis=0))
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
        total = lit = 0.35  # ambient
        for lamp in lamps:
            center = np.array(lamp["center"], float)
            across = np.cross(lamp["edge_u"], lamp["edge_v"])
            to = center - p
            d = np.linalg.norm(to, axis=-1)
            shine = np.maximum(0, -(to @ across) / d) * np.abs((to * normal).sum(-1)) / d / (np.pi * d * d) * lamp["intensity"]
            total = total + shine
            lit = lit + shine * shadow(p, casters, center)
        s = cv2.GaussianBlur((lit / total).astype(np.float32), (0, 0), BLUR_PX)[..., None]
        papers = code(linear(real) * s)
        for name, picture in (("no light map", real), ("MixIn3D's method", papers)):
            to = folder / name
            (to / "composite").mkdir(parents=True, exist_ok=True)
            (to / "cg_alpha").mkdir(exist_ok=True)
            share = cg[..., None] / 255.0
            cv2.imwrite(str(to / "composite" / (stem + ".png")), np.round(share * made + (1 - share) * picture).astype(np.uint8))
            cv2.imwrite(str(to / "cg_alpha" / (stem + ".png")), cg)
        if a.pictures:
            pathlib.Path(a.pictures).mkdir(parents=True, exist_ok=True)
            really = next(cv2.imread(str(f)) for f in (truth / "composite").glob(stem + ".*"))
            others = [cv2.imread(str(folder / n / "composite" / (stem + ".png"))) for n in ("no light map", "MixIn3D's method")]
            cv2.imwrite(str(pathlib.Path(a.pictures) / (stem + ".png")), np.vstack([np.hstack([really, made]), np.hstack(others)]))
    for name in ("no light map", "MixIn3D's method"):
        results[name] = score(folder / name)

print(f'{"":20}' + "".join(f"{k:>14}" for k in TARGETS))
print(f'{"target":20}' + "".join(f"{v:>14}" for v in TARGETS.values()))
for name, result in results.items():
    print(f"{name:20}" + "".join(f"{result[k]:14.4f}" for k in TARGETS))
for name, stages in cost.items():
    print(f"core-ms, {name}: " + ", ".join(f"{k} {v:.1f}" for k, v in stages.items()))
