"""Data classes: clearances that a growing tree must keep, and a trial bifurcation."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from design.tissue.columns import GridArrays
from design.vasculature.growth.state import TRUNK
from design.vasculature.limits import Limits
from kernels import scalar_jit

MARGIN, MARGIN_LEFT, MARGIN_AT_MOST = 1.02, 0.03, 1.15
"""Trial forks must fit with larger radii, because every later terminal widens its path: by the
first factor, plus the second times the logarithm of how often the tree has yet to grow by e, the
third at most."""


class Clearances(NamedTuple):
    """The tissue and the distances to be kept, as kernels take them.

    Attributes
    ----------
    grid : GridArrays
    wall : float, mm
        Kept from the tissue's surface.
    clearance : float, mm
    ratio : float
        Clearance over the thinner radius; the larger of the two counts.
    length_to_radius : float
    reserve : float
        Factor on the radii of a trial fork and its neighbours; see `MARGIN`.
    limits : Limits
        On angles and flows at joints.
    widest_branch : float
        Of a given trunk, over the root's radius: one as wide takes on no more terminals; inf for
        no limit.
    """

    grid: GridArrays
    wall: float
    clearance: float
    ratio: float
    length_to_radius: float
    reserve: float
    limits: Limits
    widest_branch: float


class TrialBifurcation(NamedTuple):
    """A trial bifurcation on a segment: its place, the new end, three radii (mm).

    ``flow`` and ``thick`` are what the new branch brings; see `cost.Sprout`.
    """

    segment: np.int64
    bx: float
    by: float
    bz: float
    tx: float
    ty: float
    tz: float
    up: float
    low: float
    new: float
    flow: float
    thick: float


@scalar_jit
def kept_apart(room: Clearances, one: float, two: float) -> float:
    """Clearance between vessels of radii ``one`` and ``two``, mm."""
    return max(room.clearance, room.ratio * min(one, two))


@scalar_jit
def widest_of(segments: Any, room: Clearances, i: int) -> float:
    """Radius from which on segment ``i`` takes on no more terminals, mm; inf for a trunk's."""
    if segments[i].given == TRUNK or not room.widest_branch < np.inf:
        return np.inf
    return room.widest_branch * segments[0].radius


@scalar_jit
def neighbours_of(segments: Any, index: Any) -> tuple[np.int64, np.int64, np.int64, np.int64]:
    """Parent, sibling and children of a segment, -1 for none."""
    s = segments[index]
    sibling = np.int64(-1)
    if s.parent >= 0:
        above = segments[s.parent]
        sibling = np.int64(above.right if above.left == index else above.left)
    # One width for all four, so that callers may loop over them.
    return np.int64(s.parent), np.int64(sibling), np.int64(s.left), np.int64(s.right)
