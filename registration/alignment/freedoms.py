"""List the shifts and turns of the part that a scan leaves uncertain by more than 50 µm."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.motion import AXES

UNKNOWN_MM = 0.05
"""Half width of the 95 % interval from which a degree of freedom counts as not known."""


@dataclass(frozen=True)
class LooseFreedom:
    """A direction in which the part may be moved without contradicting the scan.

    Attributes
    ----------
    words : str
        "its place along x", "its turn about z".
    half_mm : float, mm
        RMS over the part's corners of the 95 % interval's half width.
    """

    words: str
    half_mm: float


def loose_freedoms(covariance: FloatArray, bounds: FloatArray) -> tuple[LooseFreedom, ...]:
    """Return what isn't known to `UNKNOWN_MM`, the worst first.

    Eigenvalues of the covariance (6, 6) of rotation about the middle and shift, measured by how
    far they move the corners of the part's box.

    Parameters
    ----------
    covariance : (6, 6) float64
        Of a rotation vector (rad) about the middle of `bounds`, and of a shift (mm).
    bounds : (2, 3) float64, mm
    """
    corners = np.array(list(product(*bounds.T))) - bounds.mean(axis=0)
    # Mean square of the corners' movement is q' metric q; with metric = L L' lengths are L' q.
    lever = np.zeros((len(corners), 3, 6))
    for k in range(3):
        lever[:, :, k] = np.cross(np.eye(3)[k], corners)
        lever[:, k, 3 + k] = 1.0
    metric = np.einsum("cik,cil->kl", lever, lever) / len(corners)
    root = np.linalg.cholesky(metric)
    variance, vectors = np.linalg.eigh(root.T @ covariance @ root)
    out = []
    for value, vector in zip(variance[::-1], vectors.T[::-1], strict=True):
        half = 1.96 * float(np.sqrt(max(value, 0.0)))
        if half > UNKNOWN_MM:
            out.append(LooseFreedom(_words(vector), half))
    return tuple(out)


def _words(vector: FloatArray) -> str:
    """Name the strongest part of a movement whose six parts are lengths."""
    strongest = int(np.abs(vector).argmax())
    if strongest < 3:
        return f"its turn about {AXES[strongest]}"
    return f"its place along {AXES[strongest - 3]}"
