"""Pose of a part in a synthetic scan."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.scans.designs import Design

MARGIN_MM = np.array([0.4, 0.4, 0.25])
UPRIGHT = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Pose:
    """Part to scan (4, 4), mm, z down; scale (3,) along the part's axes; field of view (3,), mm."""

    transform: np.ndarray
    scale: np.ndarray
    extent: np.ndarray


def draw(design: Design, asked: argparse.Namespace, rng: np.random.Generator) -> Pose:
    """Return the pose asked for; what isn't given comes from the generator."""
    yaw, tilt_x, tilt_y = rng.uniform((-12, -2, -2), (12, 2, 2))
    scale = np.array(asked.shrink) if asked.shrink else rng.uniform(0.965, 1.005, 3)
    yaw = yaw if asked.yaw is None else asked.yaw
    tilt_x, tilt_y = asked.tilt if asked.tilt else (tilt_x, tilt_y)
    facing = np.eye(3) if asked.turned_over else UPRIGHT
    small = Rotation.from_euler("xyz", (tilt_x, tilt_y, yaw), degrees=True).as_matrix()
    sides = sorted(Rotation.create_group("O").as_matrix().round(), key=lambda m: -np.trace(m))
    linear = small @ sides[asked.orientation] @ facing @ np.diag(scale)
    size = design.body.size
    corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * size @ linear.T
    shift = MARGIN_MM - corners.min(axis=0) + rng.uniform(0, 0.05, 3)
    extent = corners.max(axis=0) + shift + MARGIN_MM
    if asked.half_field:
        extent = extent * [0.5, 1, 1]
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = linear, shift - linear @ (size / 2)
    return Pose(transform, scale, extent)
