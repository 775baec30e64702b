#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Steps of brightness where a room's colours change from one view of its sweep to the next.

evaluate_seams.py PREDICTED REFERENCE DEPTH ENVIRONMENT RIG POSES

PREDICTED and REFERENCE are pictures of one camera, DEPTH its true z in mm, RIG and the first line of POSES (TUM, T_world_color) where it
stands; ENVIRONMENT has the sweep. Borders run where the view whose own border is farthest changes, and where a view ends. On both sides of each
border pixel PREDICTED - REFERENCE is averaged over 15 px (textured pixels left out); a step is the difference of the two. JSON: mean and p95 of
the steps in grey levels, and what the same gives along the same lines moved by 45 px, where there is no border.
"""
import json
import pathlib
import sys

import cv2
import numpy as np

from tum_pose import pose_of

SIDE_PX, MOVED_PX, LEAST_PX, TEXTURE = 31, 45, 100, 12


def steps(off, use, labels):
    """Of all pixels beside a border between two labels."""
    found = []
    near = lambda mask: cv2.boxFilter(mask.astype(np.float32), -1, (SIDE_PX, SIDE_PX), normalize=False)
    beside = np.zeros(labels.shape, bool)
    beside[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    beside[1:] |= labels[1:] != labels[:-1]
    sums = {}
    for label in np.unique(labels):
        mask = (labels == label) & use
        sums[label] = (near(mask), near(np.where(mask, off, 0)))
    pairs = set(map(tuple, np.stack([labels[:, 1:], labels[:, :-1]], -1)[labels[:, 1:] != labels[:, :-1]]))
    pairs |= set(map(tuple, np.stack([labels[1:], labels[:-1]], -1)[labels[1:] != labels[:-1]]))
    for a, b in {tuple(sorted(p)) for p in pairs}:
        (n_a, s_a), (n_b, s_b) = sums[a], sums[b]
        at = beside & (n_a >= LEAST_PX) & (n_b >= LEAST_PX) & ((labels == a) | (labels == b))
        found.append(np.abs(s_a[at] / n_a[at] - s_b[at] / n_b[at]))
    return np.concatenate(found) if found else np.zeros(0)


predicted, reference, depth, environment, rig, poses = sys.argv[1:]
z = cv2.imread(depth, -1).astype(np.float64) / 1000
truth = cv2.imread(reference).astype(np.float32)
off = (cv2.imread(predicted).astype(np.float32) - truth).mean(-1)
c = json.loads(pathlib.Path(rig).read_text())["cameras"]["color"]
K = np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1.0]])
lens = np.array([c.get(k, 0.0) for k in ("k1", "k2", "p1", "p2", "k3")])
height, width = z.shape
v, u = np.mgrid[:height, :width]
rays = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2).astype(np.float64), K, lens).reshape(height, width, 2)
T = pose_of([float(n) for n in next(line for line in open(poses) if line[0] != "#").split()[1:]])
world = np.concatenate([rays * z[..., None], z[..., None]], -1) @ T[:3, :3].T + T[:3, 3]
margins = []
for frame in json.loads((pathlib.Path(environment) / "environment.json").read_text())["frames"]:
    P = np.linalg.inv(np.array(frame["T_world_color"]).reshape(4, 4))
    p = (world @ P[:3, :3].T + P[:3, 3]).reshape(-1, 3)
    front = (p[:, 2] > 0.1) & (np.abs(p[:, :2]) < 0.8 * p[:, 2:]).all(-1)
    at, _ = cv2.projectPoints(np.where(front[:, None], p, [0, 0, 1.0]), np.zeros(3), np.zeros(3), K, lens)
    at = at.reshape(-1, 2)
    margin = np.minimum(np.minimum(at[:, 0], width - 1 - at[:, 0]), np.minimum(at[:, 1], height - 1 - at[:, 1]))
    margins.append(np.where(front, margin, -1).reshape(height, width))
margins = np.stack(margins)
nearest = np.where(margins.max(0) > 0, margins.argmax(0), -1)
flat = cv2.morphologyEx(truth.max(-1), cv2.MORPH_GRADIENT, np.ones((5, 5))) < TEXTURE
use = flat & (z > 0) & (truth.max(-1) < 245) & (nearest >= 0)
maps = [nearest] + [(m > 0).astype(int) for m in margins if 0 < (m > 0).mean() < 1]
border = np.concatenate([steps(off, use, m) for m in maps])
moved = np.concatenate([steps(off, use, np.roll(m, (MOVED_PX, MOVED_PX), (0, 1))) for m in maps])
result = {"pixels": int(border.size), "mean": float(border.mean()), "p95": float(np.percentile(border, 95)),
          "elsewhere_mean": float(moved.mean()), "elsewhere_p95": float(np.percentile(moved, 95))}
print(json.dumps(result))
