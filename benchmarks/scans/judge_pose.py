"""Judge a reported pose against the truth, up to the design's symmetries."""

from __future__ import annotations

from typing import Any

import numpy as np

Truth = dict[str, Any]


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points (n, 3) by a 4x4 matrix."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def matrices(truth: Truth) -> list[np.ndarray]:
    """Return the turns that leave the design as it is, the identity first."""
    own = [np.array(m) for m in truth.get("symmetry_matrices", [])]
    if not own:
        for letter in truth["design_symmetries"]:
            signs = -np.ones(3)
            signs["xyz".index(letter)] = 1
            own.append(np.diag(signs))
    return [np.eye(3), *own]


def about_middle(truth: Truth, matrix: np.ndarray) -> np.ndarray:
    """Return a turn about the middle of the part's box as a 4x4 matrix."""
    middle = np.mean(truth["block_mm"], axis=0)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = matrix, middle - matrix @ middle
    return out


def lattice(truth: Truth) -> np.ndarray:
    """Return the 98 points of a lattice on the faces of the part's box, mm."""
    low, high = np.array(truth["block_mm"], float)
    share = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 3), axis=-1).reshape(-1, 3)
    return np.asarray(low + share[((share == 0) | (share == 1)).any(axis=1)] * (high - low))


def best_equivalent(report: dict[str, Any], truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Return the symmetry's turn (4x4) nearest to the reported pose, and the errors there, um."""
    found = np.linalg.inv(np.array(report["scaled_scan_to_part"], float))
    true = np.array(truth["transform_model_to_scan_mm"])
    points, best = lattice(truth), None
    for matrix in matrices(truth):
        turn = about_middle(truth, matrix)
        error = 1e3 * np.linalg.norm(apply(found, points) - apply(true @ turn, points), axis=1)
        if best is None or (error**2).mean() < (best[1] ** 2).mean():
            best = (turn, error)
    assert best is not None
    return best


def judge_pose(
    report: dict[str, Any], truth: Truth, landed_um: float = 50.0, wrong_um: float = 100.0
) -> dict[str, Any]:
    """Return the target registration error; whether landed, flagged, or silently wrong."""
    turn, error = best_equivalent(report, truth)
    rms = float(np.sqrt((error**2).mean()))
    flagged = bool(report["ambiguity"]["flag"])
    mirrored = bool(truth["mirrored"]) and not truth.get("mirror_symmetric", False)
    wrong = rms > wrong_um or mirrored
    symmetric = len(matrices(truth)) > 1
    return {
        "tre_rms_um": rms,
        "tre_max_um": float(error.max()),
        "landed": rms <= landed_um and not mirrored,
        "flagged": flagged,
        "silently_wrong": not flagged and (wrong or symmetric),
        "turned": not np.allclose(turn, np.eye(4)),
    }


def scales(report: dict[str, Any], truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """Return reported and true scales along the axes of the nearest equivalent pose."""
    turn, _ = best_equivalent(report, truth)
    order = np.abs(turn[:3, :3])
    return np.array(report["scale"], float), order.T @ np.array(truth["scale"])
