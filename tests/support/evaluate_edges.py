#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How far a depth picture's edges lie from the true ones: evaluate_edges.py DEPTH.png TRUTH.png (16 bit, z in mm; 0 = not known)

An edge is a step of more than 200 mm and 8 % between two true pixels of a row or a column; it is found again where the depth crosses
the middle of the step in the same direction, at most REACH pixels away (otherwise it counts as REACH). Prints JSON.
"""
import json
import sys

import cv2
import numpy as np

REACH = 12
depth, truth = (cv2.imread(f, cv2.IMREAD_UNCHANGED).astype(np.float64) for f in sys.argv[1:3])
displaced = []
for d, t in ((depth, truth), (depth.T, truth.T)):
    step = np.diff(t, axis=1)
    known = (t[:, 1:] > 0) & (t[:, :-1] > 0)
    edge = known & (np.abs(step) > np.maximum(200, 0.08 * np.minimum(t[:, 1:], t[:, :-1])))
    rows, columns = np.nonzero(edge)
    middle = (t[rows, columns] + t[rows, columns + 1]) / 2
    sign = np.sign(step[rows, columns])
    nearest = np.full(len(rows), REACH)
    for off in sorted(range(-REACH + 1, REACH), key=abs, reverse=True):
        at = columns + off
        inside = (at >= 0) & (at + 1 < d.shape[1])
        a, b = d[rows, np.where(inside, at, 0)], d[rows, np.where(inside, at + 1, 1)]
        crosses = inside & (a > 0) & (b > 0) & ((a - middle) * sign <= 0) & ((b - middle) * sign > 0)
        nearest[crosses] = abs(off)
    displaced.append(nearest)
displaced = np.concatenate(displaced)
print(json.dumps({"edges": len(displaced), "median_px": float(np.median(displaced)), "p90_px": float(np.percentile(displaced, 90)),
                  "not_found": float((displaced == REACH).mean())}))
