"""Record of the part's frame: pose and errors, with the position uncertainty of any point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment import Fit, Uncertainty
from registration.alignment.uncertainty import ScanErrors

IN_PLANE = 2.448
"""Two normal errors of standard deviation 1 lie within this in 95 of 100 cases (Rayleigh)."""
COVERAGE = 1.96


@dataclass(frozen=True)
class Frame:
    """The part's frame as laid on the print.

    A twist is a small motion: turn (rad, about the part's middle) and shift (mm), (6,).

    Attributes
    ----------
    fit : Fit
        Scan to part, rigid.
    names : tuple of str
        Datums, the primary first; empty for the best fit.
    words : str
        How the frame was laid, to be read.
    pulls : (g, 6) float64
        Twist by one standard deviation of each independent error.
    strains : tuple of ((3, 3), (6,)) float64
        Stretch of all places about the middle by one standard deviation of the scales along and
        across the light, part's axes, and the twist that this gives the frame.
    places : tuple of (name, u_um, how far moved_um)
        Of each datum: half width of its place's 95 % interval, and where the best fit had it.
    """

    fit: Fit
    names: tuple[str, ...]
    words: str
    pulls: FloatArray
    strains: tuple[tuple[FloatArray, FloatArray], ...]
    places: tuple[tuple[str, float, float], ...] = ()

    def covariance(self, place: FloatArray) -> FloatArray:
        """Covariance (3, 3), mm², of where a place (3,) of the part is said to lie."""
        arm = place - self.fit.centre
        moved = self.pulls @ motion(arm).T
        stretched = [strain @ arm + motion(arm) @ twist for strain, twist in self.strains]
        rows = np.vstack([moved, *stretched])
        return np.asarray(rows.T @ rows)

    def along_mm(self, place: FloatArray, direction: FloatArray) -> float:
        """Half width of the 95 % interval of a place along a direction (3,), mm."""
        return COVERAGE * float(np.sqrt(direction @ self.covariance(place) @ direction))

    def across_mm(self, place: FloatArray, direction: FloatArray) -> float:
        """Radius, mm, within which a place lies across a direction (3,), 95 %.

        NaN where the place's errors aren't known, as of liquid nearly as bright as gel.
        """
        out = np.eye(3) - np.outer(direction, direction)
        across = out @ self.covariance(place) @ out
        spread = np.linalg.eigvalsh(across)[-1] if np.isfinite(across).all() else np.nan
        return IN_PLANE * float(np.sqrt(max(spread, 0.0)))


def motion(arm: FloatArray) -> FloatArray:
    """Motion (3, 6) of a place at `arm` (3,) from the middle by a twist: ω × arm + t."""
    x, y, z = arm
    turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.hstack([turn, np.eye(3)])


def strains(fit: Fit, errors: ScanErrors) -> tuple[FloatArray, FloatArray]:
    """Stretch (3, 3) by one standard deviation of the scale along and across the light."""
    beam = fit.rotation @ errors.beam
    along = np.outer(beam, beam)
    return errors.depth * along, errors.lateral * (np.eye(3) - along)


def best_fit(fit: Fit, sure: Uncertainty, errors: ScanErrors) -> Frame:
    """Return the frame of the least squares fit to all of the surface.

    Turn and shift err as those of the scaled fit do.
    """
    half = np.concatenate([np.deg2rad(sure.rotation_deg), sure.shift_mm]) / COVERAGE
    still = np.zeros(6)
    return Frame(
        fit,
        (),
        "Best fit: the design is laid on all of the seen surface by least squares, without "
        "stretching it. No datum was chosen.",
        np.diag(half),
        tuple((strain, still) for strain in strains(fit, errors)),
    )
