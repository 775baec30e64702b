#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Scores the head of a rig.json.  evaluate_head.py RIG SWEEP TRUTH [--max-deg D] [--max-mm M]

SWEEP is a folder with ptu.txt, TRUTH its TUM poses of T_world_color. For every pair of positions the relative pose
T_color1_color2 that the rig predicts from the encoders (their noise included) is compared with the truth's: rotation
and translation, root mean square over the pairs; the same over consecutive positions. World frames play no part.
Exit 4 beyond the limits.
"""
import argparse
import json
import sys

import numpy as np

from tum_pose import pose_of


def rows(name):
    return np.array([[float(v) for v in line.split()] for line in open(name) if line.strip() and line[0] != "#"])


def rotation(axis, angle):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def about(axis, degrees):
    T = np.eye(4)
    T[:3, :3] = rotation(axis["direction"], np.radians(degrees))
    T[:3, 3] = axis["point"] - T[:3, :3] @ axis["point"]
    return T


def predicted(ptu, pan, tilt):
    e = ptu.get("encoder", {})
    return (about(ptu["pan_axis"], e.get("pan_scale", 1) * pan + e.get("pan_offset_deg", 0)) @
            about(ptu["tilt_axis"], e.get("tilt_scale", 1) * tilt + e.get("tilt_offset_deg", 0)) @
            np.array(ptu["T_tilt_color"], float).reshape(4, 4))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rig"), parser.add_argument("sweep"), parser.add_argument("truth")
    parser.add_argument("--max-deg", type=float, default=float("inf"))
    parser.add_argument("--max-mm", type=float, default=float("inf"))
    args = parser.parse_args()
    ptu = json.load(open(args.rig))["ptu"]
    truth = rows(args.truth)
    ours, theirs = [], []
    for t, pan, tilt in rows(args.sweep + "/ptu.txt"):
        i = int(np.argmin(np.abs(truth[:, 0] - t)))
        if abs(truth[i, 0] - t) < 0.01:
            ours.append(predicted(ptu, pan, tilt))
            theirs.append(pose_of(truth[i][1:8]))
    inverse = np.linalg.inv
    errors = {"pairs": [], "consecutive": []}
    for i in range(len(ours)):
        for k in range(i):
            off = inverse(inverse(theirs[k]) @ theirs[i]) @ (inverse(ours[k]) @ ours[i])
            R = off[:3, :3]
            angle = np.degrees(np.arctan2(np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]), np.trace(R) - 1))
            error = angle, 1000 * np.linalg.norm(off[:3, 3])
            errors["pairs"].append(error)
            if k == i - 1:
                errors["consecutive"].append(error)
    result = {"positions": len(ours)}
    for name, list_ in errors.items():
        rms = np.sqrt(np.mean(np.square(list_), axis=0))
        result[name] = {"rotation_rms_deg": round(float(rms[0]), 5), "translation_rms_mm": round(float(rms[1]), 4)}
    print(json.dumps(result))
    good = result["pairs"]["rotation_rms_deg"] <= args.max_deg and result["pairs"]["translation_rms_mm"] <= args.max_mm
    return 0 if good else 4


sys.exit(main())
