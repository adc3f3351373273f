"""Reasons to doubt a scan's pose: free motions, misfitting walls, rivals."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit, evenness, facing
from registration.alignment.rivals import AXES, AlternativePose
from registration.alignment.symmetry import turns_into_itself

UNKNOWN_MM = 0.05
"""Half width of the 95 % interval from which a degree of freedom counts as not known."""


def loose_freedoms(covariance: FloatArray, surface: ModelSurface) -> list[str]:
    """Return a sentence for each freedom that isn't known to `UNKNOWN_MM`, the worst first.

    A turn after which the design is the same, as of a tube about its axis, is none. Eigenvalues of
    the covariance (6, 6) of rotation about the middle and shift, measured by how far they move the
    corners of the part's box.

    Parameters
    ----------
    covariance : (6, 6) float64
        Of a rotation vector (rad) about the middle of the surface's box, and of a shift (mm).
    surface : ModelSurface
    """
    bounds = surface.bounds
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
        if half <= UNKNOWN_MM:
            continue
        if turns_into_itself(surface, np.linalg.solve(root.T, vector), bounds.mean(axis=0)):
            continue
        out.append(
            f"The scan doesn't fix {_words(vector)}: known to ± {half:.2f} mm (95 %, limit "
            f"{UNKNOWN_MM:g} mm); scan more of the part."
        )
    return out


def _words(vector: FloatArray) -> str:
    """Name the strongest part of a movement whose six parts are lengths."""
    strongest = int(np.abs(vector).argmax())
    if strongest < 3:
        return f"its turn about {AXES[strongest]}"
    return f"its position along {AXES[strongest - 3]}"


OFF_MM = 0.075
"""A side whose median is off by more contradicts the pose: faces of 3 mm of depth of which one is
0.16 mm off pull a pose 0.1 mm away before a lumen's walls show it by this much."""
RAGGED = 0.1
"""A side that weighs less than this (`evenness`) says nothing of the pose."""
LEAST_SHARE = 0.02
"""A side counts from this share of the points on."""


def misfits(surface: ModelSurface, points: FloatArray, fit: Fit, blur_mm: float) -> list[str]:
    """Return a sentence for each side that is off by more than `OFF_MM`, the worst first."""
    near = surface.query(fit.apply(points))
    residual = near.distance - surface.blurred(near.face, blur_mm) - fit.offset_mm
    side = facing(near.direction, surface.curvature[near.face])
    even = evenness(residual, side)
    out = []
    for number in range(12):
        here = side == number
        if here.mean() < LEAST_SHARE or even[here][0] < RAGGED:
            continue
        off = float(np.median(residual[here]))
        if abs(off) > OFF_MM:
            what = "curved walls" if number % 2 else "flat faces"
            end = "high" if number // 2 % 2 else "low"
            out.append((-abs(off), off, f"{what} that face {end} {AXES[number // 4]}"))
    return [
        f"After the fit the {walls} are off the design by {1e3 * off:+.0f} µm (limit "
        f"{1e3 * OFF_MM:.0f} µm), so the pose isn't known better than that; check the refractive "
        "index and how deep light reaches, or the print."
        for _, off, walls in sorted(out, key=lambda row: row[0])
    ]


def rival_doubts(rivals: Iterable[AlternativePose], limit: float) -> list[str]:
    """Return a sentence for each rival pose whose lead is below `limit`."""
    return [
        rival_words(rival, limit)
        for rival in rivals
        if rival.lead < limit and not (rival.mirrored and rival.same)
    ]


CROSS_UM = 15.0
"""Two programs differ by less about where a well-seen surface lies: by 1 to 11 µm at the corners in
25 scans of four generators whose walls were told rightly, by 29 and more (17 at a face) in 13
others, nearly all with false walls."""
LEAST_SEEN = 0.5
"""Share of the scanned surface that light must reach: levels are told from there alone."""


def later_doubts(cross_um: float | None, seen: float) -> tuple[str, ...]:
    """Return a sentence for each reason that is known only after the fit.

    Parameters
    ----------
    cross_um : float or None, µm
        Between our pose and another program's.
    seen : float
        Share of the scanned surface that lies where light reaches.
    """
    out = []
    if cross_um is not None and cross_um > CROSS_UM:
        out.append(
            f"A second registration program (small_gicp) places the design up to {cross_um:.0f} µm "
            f"away from this pose (limit {CROSS_UM:g} µm), so one of the two is wrong; compare the "
            "contours with the raw scan, and scan with more light or contrast."
        )
    if seen < LEAST_SEEN:
        out.append(
            f"Light reached {100 * seen:.0f} % of the scanned surface (limit "
            f"{100 * LEAST_SEEN:.0f} %), too little to tell gel from liquid by; scan with more "
            "light or contrast."
        )
    return tuple(out)


def rival_words(rival: AlternativePose, limit: float) -> str:
    """Say where else the part may lie and what would tell."""
    if rival.same:
        return (
            f"The design is the same after {rival.motion}, so the scan can't show which way the "
            "part lay."
        )
    x, y, z = rival.place_mm
    where = f"most (by {rival.apart_um:.0f} µm) at x {x:.2f}, y {y:.2f}, z {z:.2f} mm"
    return (
        f"The part may lie otherwise, {_by(rival.motion)}: that pose deviates only "
        f"{rival.lead:.2f} times as much where the two differ (limit {limit:g}). They differ "
        f"{where}, {_remedy(rival)}."
    )


def _by(motion: str) -> str:
    """Put "by" before each part of a motion that takes it: turns and shifts, no mirroring."""
    parts = motion.split(" and ")
    return " and ".join(part if part.startswith("mirrored") else f"by {part}" for part in parts)


def _remedy(rival: AlternativePose) -> str:
    if rival.seen:
        return "which was seen but doesn't decide; scan it more sharply"
    if rival.amid:
        return (
            "where the design has a surface and the scan found none, though it did around it: the "
            "print lacks it, or light failed there"
        )
    return "which wasn't seen; scan it too"
