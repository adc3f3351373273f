"""Compute a registration's pose error against the simulated scanner's true pose."""

from __future__ import annotations

from typing import Any

import numpy as np

from kernels.arrays import FloatArray


def pose_error(
    scan_to_part: FloatArray,
    truth_printer_to_scan: FloatArray,
    place: FloatArray,
    box: FloatArray,
    written: FloatArray | None = None,
) -> dict[str, Any]:
    """Displacement of the part's corners by the error of the recovered transform.

    Parameters
    ----------
    scan_to_part : (4, 4)
        As registration found it, scales included.
    truth_printer_to_scan : (4, 4)
        As the scanner placed and shrank the part.
    place : (3,) mm
        Part to printer.
    box : (2, 3) mm
        The part's bounds; its eight corners are tried.
    written : (4, 4), optional
        Design to what was written, of a compensated print.

    Returns
    -------
    dict
        ``pose_error_um`` (largest), ``pose_error_mean_um``.
    """
    corners = np.array(
        [[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    made = corners if written is None else _apply(written, corners)
    scanned = _apply(truth_printer_to_scan, made + place)
    error = np.linalg.norm(_apply(scan_to_part, scanned) - corners, axis=1) * 1e3
    return {"pose_error_um": float(error.max()), "pose_error_mean_um": float(error.mean())}


def _apply(transform: FloatArray, points: FloatArray) -> FloatArray:
    return points @ transform[:3, :3].T + transform[:3, 3]
