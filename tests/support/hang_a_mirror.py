#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Hangs a mirror on a wall of a swept room: its depth pictures then show what the wall reflects.

hang_a_mirror.py VIEWS RIG POSES PLANE FROM TO ROOM

VIEWS   a folder of a scan's views, changed in place; POSES its T_world_color in TUM lines
PLANE   axis=coordinate of the wall, FROM and TO the mirror's corners x,y,z, ROOM the room's largest x,y,z (its least are 0);
        all in the world, metres. Only pixels are changed that measure the wall there, to 0.3 m.
"""
import json
import pathlib
import sys

import cv2
import numpy as np

from tum_pose import pose_of

views, rig_file, poses_file, plane, low, high, size = sys.argv[1:]
rig = json.loads(pathlib.Path(rig_file).read_text())
camera = rig["cameras"]["depth"]
T_color_depth = np.array(rig["T_color_depth"]).reshape(4, 4)
axis, wall = "xyz".index(plane[0]), float(plane[2:])
low, high, size = (np.array([float(v) for v in corner.split(",")]) for corner in (low, high, size))
poses = [list(map(float, line.split())) for line in pathlib.Path(poses_file).read_text().splitlines() if line.strip() and line[0] != "#"]

v, u = np.mgrid[0:camera["height"], 0:camera["width"]]
K = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1.0]])
xy = cv2.undistortPoints(np.stack([u, v], -1).reshape(-1, 1, 2).astype(np.float64), K, np.array([camera["k1"], camera["k2"], 0, 0])).reshape(-1, 2)
rays = np.c_[xy, np.ones(len(xy))]
rays /= np.linalg.norm(rays, axis=1, keepdims=True)


def to_box(origin, ray):
    with np.errstate(divide="ignore"):
        return np.where(ray > 0, (size - origin) / ray, -origin / ray).min(axis=1)


changed = 0
for file in sorted((pathlib.Path(views) / "depth").iterdir()):
    T = pose_of(poses[int(file.stem.split("_")[0])][1:]) @ T_color_depth
    world = rays @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        to_wall = (wall - T[axis, 3]) / world[:, axis]
    to_wall[~(to_wall > 0)] = np.inf
    hit = T[:3, 3] + np.where(np.isfinite(to_wall), to_wall, 0)[:, None] * world
    counts = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    measured = counts.reshape(-1) * camera["unit_m"]
    inside = np.isfinite(to_wall) & (np.abs(measured - to_wall) < 0.3)
    for k in range(3):
        if k != axis:
            inside &= (hit[:, k] > low[k]) & (hit[:, k] < high[k])
    mirrored = world.copy()
    mirrored[:, axis] *= -1
    beyond = to_box(hit + 1e-6 * mirrored, mirrored)
    measured[inside] = (measured[inside] + beyond[inside]) % camera["unambiguous_range_m"]
    changed += int(inside.sum())
    cv2.imwrite(str(file), np.round(measured / camera["unit_m"]).astype(np.uint16).reshape(counts.shape))
print(changed)
