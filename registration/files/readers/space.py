"""Check a scan file's axis directions in space, and map the scan's frame into that space."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from registration.errors import ScanFileError
from registration.space import Space

LPS = "LPS"
_MOST_SKEW_DEGREES = 0.1
"""Axes that are square to this are kept: less than 2 µm at 1 mm."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FileSpace:
    """How a file's axes run in a right-handed space.

    Attributes
    ----------
    name : str
        Of the space (`Space.name`).
    directions : (3, 3) float64
        Rows: unit vectors along the array's axes 0, 1, 2, in space.
    origin : (3,) float64, mm
        Centre of voxel (0, 0, 0).
    """

    name: str
    directions: Floats
    origin: Floats

    def is_right_handed(self, axes: str) -> bool:
        """Whether x, y, z, as `axes` names the array's axes, make a right-handed frame."""
        return float(np.linalg.det(self._by_name(axes))) > 0

    def of_scan(self, axes: str, reversed_mm: float | None) -> Space:
        """The scan's frame in the space.

        Parameters
        ----------
        axes : str
            Names of the array's axes, slowest first.
        reversed_mm : float or None, mm
            From the first to the last voxel along y where y was reversed.
        """
        rows, origin = self._by_name(axes), self.origin
        if reversed_mm is not None:
            origin = origin + reversed_mm * rows[1]
            rows = rows * np.array([[1.0], [-1.0], [1.0]])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rows.T, origin
        return Space(self.name, matrix)

    def _by_name(self, axes: str) -> Floats:
        """Rows along x, y, z."""
        return self.directions[[axes.lower().index(name) for name in "xyz"]]


def file_space(name: str, steps: ArrayLike, origin: ArrayLike, path: Path) -> FileSpace:
    """A file's axes in space, from a step along each (rows: array axes 0, 1, 2; any length).

    Raises
    ------
    ScanFileError
        When a step has no direction, or the axes aren't square to each other: such a volume can't
        be kept as a box of voxels.
    """
    rows = np.asarray(steps, dtype=np.float64).reshape(3, 3)
    start = np.asarray(origin, dtype=np.float64).reshape(3)
    lengths = np.linalg.norm(rows, axis=1)
    if not (np.isfinite(rows).all() and np.isfinite(start).all() and lengths.min() > 0):
        raise ScanFileError(
            f"{path}: its header gives an axis the direction {_worst(rows, lengths)}; write it "
            "again with a direction for each axis, or without orientation"
        )
    units = rows / lengths[:, None]
    for first, second in ((0, 1), (0, 2), (1, 2)):
        cosine = float(np.clip(units[first] @ units[second], -1, 1))
        angle = float(np.degrees(np.arccos(cosine)))
        if abs(angle - 90) > _MOST_SKEW_DEGREES:
            raise ScanFileError(
                f"{path}: array axes {first} and {second} meet at {angle:.2f}° (needed: 90 ± "
                f"{_MOST_SKEW_DEGREES:g}°), a sheared volume (a tilted gantry?); resample it to "
                "a straight grid in the program that wrote it"
            )
    return FileSpace(name, units, start)


def _worst(rows: Floats, lengths: Floats) -> list[float]:
    bad = int(np.argmin(np.where(np.isfinite(lengths), lengths, -1)))
    return [float(value) for value in rows[bad]]
