"""Read a scan's pose from an earlier registration.json, or align the scan with the design now."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import align
from registration.alignment.distance import ModelSurface
from registration.errors import AlignmentError, RegistrationError
from registration.scan import Scan
from registration.segmentation import Segmentation

FitName = Literal["scaled", "rigid"]

_KEYS: Final[dict[FitName, str]] = {
    "scaled": "scaled_scan_to_part",
    "rigid": "transform_scan_to_part",
}
_UNFINISHED: Final = (
    "A print that isn't finished, or is symmetric, can't be aligned by itself: give --pose "
    "registration.json of a scan in the same place"
)
_STRETCH: Final = (0.5, 2.0)
"""A pose that stretches by less or more isn't one of a print."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Scan to part, and where that is from.

    Attributes
    ----------
    matrix : (4, 4) float64
        Homogeneous, mm.
    said : str
        One sentence for the reader.
    aligned : bool
        Whether this scan itself was aligned.
    notes : tuple of str
        Doubts.
    """

    matrix: FloatArray
    said: str
    aligned: bool
    notes: tuple[str, ...] = ()


def read_pose(path: Path, fit: FitName = "scaled") -> Pose:
    """Take the pose from a registration.json of `printctl register` or of a run.

    Raises
    ------
    RegistrationError
        When the file can't be read, or holds no pose.
    """
    remedy = "give the registration.json of `printctl register` or of a run folder"
    try:
        numbers = json.loads(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise RegistrationError(f"--pose {path} can't be read: {exc.strerror}; {remedy}") from exc
    except ValueError as exc:
        raise RegistrationError(f"--pose {path} isn't JSON ({exc}); {remedy}") from exc
    matrix = _matrix(numbers, _KEYS[fit])
    if matrix is None:
        raise RegistrationError(
            f"--pose {path} holds no {_KEYS[fit]}, a 4 × 4 matrix of numbers; {remedy}"
        )
    _check(matrix, path, remedy)
    stands = f"The pose is that of {path}, {fit} fit; this scan itself wasn't aligned."
    flagged = bool(_section(_section(numbers).get("ambiguity")).get("flag"))
    doubt = ("That registration called its pose ambiguous.",) if flagged else ()
    return Pose(matrix, stands, False, doubt)


def _section(numbers: Any) -> dict[str, object]:
    """The registration's numbers, which `register` and a report put one level down."""
    if not isinstance(numbers, dict):
        return {}
    inner = numbers.get("registration", numbers)
    return inner if isinstance(inner, dict) else {}


def _matrix(numbers: Any, key: str) -> FloatArray | None:
    try:
        matrix = np.array(_section(numbers)[key], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        return None
    return matrix if matrix.shape == (4, 4) and np.isfinite(matrix).all() else None


def _check(matrix: FloatArray, path: Path, remedy: str) -> None:
    stretch = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    turned = np.linalg.det(matrix[:3, :3]) > 0 and np.allclose(matrix[3], [0, 0, 0, 1])
    if not turned or stretch.min() < _STRETCH[0] or stretch.max() > _STRETCH[1]:
        raise RegistrationError(
            f"--pose {path}: its matrix is no pose of a print (it mirrors, or stretches by "
            f"{stretch.min():.3g} to {stretch.max():.3g}; {_STRETCH[0]:g} to {_STRETCH[1]:g} can "
            f"be); {remedy}"
        )


def align_pose(
    scan: Scan, segmentation: Segmentation, model: Solid, fit: FitName = "scaled"
) -> Pose:
    """Align the scan with the whole design.

    Raises
    ------
    AlignmentError
        When they don't fit each other, or fit in several ways, as the scan of a print that isn't
        finished does.
    """
    points = segmentation.surface.vertices[segmentation.seen]
    try:
        alignment = align(
            ModelSurface.of(model),
            points,
            scan.depth_down,
            blur_mm=segmentation.field.blur_mm,
            depth_standard=scan.depth_standard,
        )
    except AlignmentError as exc:
        raise AlignmentError(f"{exc}. {_UNFINISHED}") from exc
    if alignment.ambiguous:
        raise AlignmentError(
            f"the pose isn't sure, and lines would be held against the wrong places: "
            f"{' '.join(alignment.doubts)} {_UNFINISHED}"
        )
    matrix = (alignment.scaled if fit == "scaled" else alignment.rigid).matrix
    return Pose(matrix, f"This scan was aligned with the whole design, {fit} fit.", True)
