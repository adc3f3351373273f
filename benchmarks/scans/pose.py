"""Pose of a part in a synthetic scan, and the design's symmetries about its middle."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.scans.designs import Design

NEAR_MM = 0.03


def signed_permutations() -> list[np.ndarray]:
    """Return the 48 orthogonal matrices that permute and reverse axes."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            out.append(np.eye(3)[list(order)] * np.array(signs)[:, None])
    return out


def turns() -> list[np.ndarray]:
    """Return the 24 rotations among them."""
    return [m for m in signed_permutations() if np.linalg.det(m) > 0]


def signature(design: Design) -> np.ndarray:
    """Return points on all axes with their radii, (n, 4) mm, about the middle of the body."""
    rows = []
    for vessel in design.vessels:
        length = vessel.along[-1]
        along = np.linspace(0, length, int(length / 0.05) + 2)
        rows.append(
            np.column_stack([vessel.at(along) - design.body.size / 2, vessel.radius_at(along)])
        )
    return np.concatenate(rows)


def same_body(design: Design, matrix: np.ndarray) -> bool:
    """Whether a turn or reflection about its middle leaves the body as it is."""
    middle, body = design.body.size / 2, design.body
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (4000, 3)) * body.size
    return bool(
        np.abs(body.depth(points + middle) - body.depth(points @ matrix.T + middle)).max() < NEAR_MM
    )


def symmetries(design: Design) -> tuple[list[np.ndarray], bool]:
    """Return the rotations (without identity) that keep a design, and whether a mirror does."""
    points = signature(design)
    tree = cKDTree(points)
    found, mirror = [], False
    for matrix in signed_permutations():
        if not same_body(design, matrix):
            continue
        turned = np.column_stack([points[:, :3] @ matrix.T, points[:, 3]])
        if tree.query(turned)[0].max() > NEAR_MM:
            continue
        if np.linalg.det(matrix) < 0:
            mirror = True
        elif not np.allclose(matrix, np.eye(3)):
            found.append(matrix)
    return found, mirror


def letters(matrices: list[np.ndarray]) -> list[str]:
    """Return the axes of the half turns among them, as 'x', 'y', 'z'."""
    half = [m for m in matrices if np.allclose(m, np.diag(np.diag(m)))]
    return sorted("xyz"[int(np.argmax(np.diag(m)))] for m in half)


MARGIN_MM = np.array([0.4, 0.4, 0.25])
UPRIGHT = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Pose:
    """Part (mm) to scan (mm, x y z, z down).

    Attributes
    ----------
    transform : (4, 4) float
    rotation : (3, 3) float
    scale : (3,) float
        Along the part's axes.
    extent : (3,) float, mm
        Of the field of view.
    """

    transform: np.ndarray
    rotation: np.ndarray
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
    upright = sorted(turns(), key=lambda m: -np.trace(m))
    rotation = small @ upright[asked.orientation] @ facing
    linear = rotation @ np.diag(scale)
    size = design.body.size
    corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * size @ linear.T
    shift = MARGIN_MM - corners.min(axis=0) + rng.uniform(0, 0.05, 3)
    extent = corners.max(axis=0) + shift + MARGIN_MM
    if asked.half_field:
        extent = extent * [0.5, 1, 1]
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = linear, shift - linear @ (size / 2)
    return Pose(transform, rotation, scale, extent)
