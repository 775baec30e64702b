# SPDX-License-Identifier: Apache-2.0
"""Poses of TUM trajectories."""
import numpy as np


def pose_of(numbers):
    """4x4 of x y z qx qy qz qw; the quaternion need not have length 1."""
    x, y, z, w = np.asarray(numbers[3:], float) / np.linalg.norm(numbers[3:])
    T = np.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = numbers[:3]
    return T
