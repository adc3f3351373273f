"""Symmetries that a design has about the middle of its bounding box."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree

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
