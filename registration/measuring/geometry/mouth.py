"""Extrapolate a lumen's axis to its mouth, and form the mouth's datum equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.geometry.polyline import vectors_across
from kernels.arrays import FloatArray
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.features import plane_rows
from registration.measuring.geometry.filters import open_filter
from registration.measuring.geometry.fit_state import Setting, light_across
from registration.measuring.geometry.frame import motion
from registration.measuring.geometry.lumen import Lumen
from registration.measuring.geometry.nested import Rows

MOUTH_DIAMETERS = 2.0
"""Of a vessel that its mouth is told from."""


@dataclass(frozen=True)
class AxisEnd:
    """Where a lumen's axis reaches its free end.

    Attributes
    ----------
    node, way : (3,) float64, mm
        As designed: the end of the axis, and the unit way out.
    off : (3,) float64, mm
        Measured less designed, across that way.
    noise_mm : float, mm
        Standard deviation of one coordinate.
    """

    node: FloatArray
    way: FloatArray
    off: FloatArray
    noise_mm: float


def mouth(lumen: Lumen, last: bool) -> AxisEnd | None:
    """Carry the axis on to a free end; None where no section near it was measured.

    A straight line through the offsets of the sections within two diameters of the end; the
    nearest must lie within one.
    """
    node, way, radius = lumen.line.end(last)
    from_end = lumen.line.length - lumen.along if last else lumen.along
    near = from_end < 2 * radius * MOUTH_DIAMETERS
    if near.sum() < 3 or from_end[near].min() > 2 * radius:
        return None
    off = lumen.raw - lumen.line.nearest(lumen.raw)[0]
    off = off - (off @ way)[:, None] * way
    weights = np.zeros(len(off))
    # Wide weights: a straight line through all of them.
    weights[near] = open_filter(from_end[near], 100.0 * radius, np.zeros(1))[0]
    return AxisEnd(node, way, weights @ off, lumen.shared(weights))


def mouth_rows(end: AxisEnd, face: Face | None, there: Setting) -> Rows:
    """Return what a mouth asks: its middle, and where it was seen the face around it."""
    u, v = vectors_across(end.way)
    arm = end.node - there.fit.centre
    light = light_across(there, u, v)
    matrix = [side @ motion(arm) for side in (u, v)]
    asked = [-(side @ end.off) for side in (u, v)]
    pulls = [[end.noise_mm, 0], [0, end.noise_mm], list(light)]
    strained = [[-(side @ s @ arm) for side in (u, v)] for s in there.strains]
    rows = Rows(np.array(matrix), np.array(asked), np.array(pulls), np.array(strained))
    if face is None or face.normal is None:
        return rows
    plane = plane_rows(face, there)
    # The plane's distance at the mouth, from that at its middle and both tilts.
    reach = face.size_mm / 2
    away = end.node - there.fit.apply(face.scanned).mean(axis=0)
    s, t = (away @ side / reach for side in vectors_across(face.normal))
    here = np.array([s, t, 1.0])
    both = np.zeros((len(rows.pulls) + len(plane.pulls), 3))
    both[: len(rows.pulls), :2] = rows.pulls
    both[len(rows.pulls) :, 2] = plane.pulls @ here
    return Rows(
        np.vstack([rows.matrix, here @ plane.matrix]),
        np.append(rows.asked, here @ plane.asked),
        both,
        np.column_stack([rows.strained, plane.strained @ here]),
    )
