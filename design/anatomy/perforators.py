"""Plan branches that dive from a heart's epicardial trunks into its septum and thick walls."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.anatomy.perforator_ways import Room, Ways, pieces_along
from design.anatomy.trunk_lines import TrunkLines, with_shares
from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature.options import GrowthOptions
from kernels.arrays import FloatArray, IntArray

NARROW: Final = 0.2
"""Radius over the root's that a perforator is to stay below: what is wider is a trunk, and belongs
below the epicardium. Ours."""

_FULL: Final = 0.19
"""Radius over its root's that a perforator may be planned for at most: others then part its work.
A little below `NARROW`, as growth spreads terminals a little differently."""

_FILLED: Final = 0.25
"""Of what a perforator as wide as that feeds: part that each is planned for. Those that get more
than their share stay below it, then."""

_PIECE: Final = 0.25
"""Of the edge of the cube that a perforator serves: such pieces follow a thin wall's bends."""

_CROWDED: Final = 2.0
"""Way of a place from all vessels, over the depth that a perforator needs, below which it gets no
other; and ways about a place that can't be reached which are given up with it, over its own."""

_LINKED: Final = 0.7
"""Of the depth that a perforator needs, what ways have between their places."""

_PLACES: Final = 6000
"""Of the tissue, between which ways are found."""

_FINE: Final = 8.0
"""Places along a perforator for each such distance that it serves."""

_LEAST_FED, _FEW_FED = 4, 12
"""Terminals that a perforator is planned for at least; and where one that feeds four would be as
wide as a trunk already, so that there are too few terminals for narrow ones."""


def with_perforators(
    tissue: Tissue,
    lines: TrunkLines,
    radius: FloatArray,
    volume: FloatArray,
    options: GrowthOptions,
) -> tuple[TrunkLines, FloatArray]:
    """The lines with branches to the places that are farthest from all of them; and all radii.

    Each leaves a trunk by itself and feeds a small part, as septal perforators do, so that none is
    as wide as a trunk. There are as many as bring all tissue as near as the edge of a cube that
    one is planned for; and beside those that feed too much for that, as many more as find room.

    Parameters
    ----------
    lines, radius : TrunkLines, (n,) float64, mm
        Trunks, laid.
    volume : (k, 3) float64, mm
        Points all over the tissue.
    """
    power = 1.0 / options.murray_exponent
    roots = lines.share[lines.parent < 0]
    root = float(radius.max() / roots.max() ** power)
    narrow = NARROW**options.murray_exponent * float(roots.min())
    least = (
        _LEAST_FED if options.terminals * narrow > _LEAST_FED else _FEW_FED
    ) / options.terminals
    part = max(_FILLED * narrow, least)
    near_mm = float(np.cbrt(part * tissue.volume_mm3))
    room = Room(tissue, lines, radius, root * part**power, options.clearance_mm, _PIECE * near_mm)
    deep = volume[-tissue.grid.distance(volume) >= room.need_mm]
    try:
        ways = Ways.through(tissue, deep[:_PLACES], _LINKED * room.need_mm, lines.points)
    except GrowthError:
        return lines, radius  # too thin for any
    while (site := int(np.argmax(ways.away))) >= 0 and ways.away[site] > near_mm:
        path = room.path_to(ways, site)
        if path is None:
            ways.leave(site, 0.5 * near_mm)
        else:
            ways.take(pieces_along(path[:-1], path[1:], near_mm / _FINE)[0])
    most = max(_FULL**options.murray_exponent, least / float(roots.min()))
    whole = _parted(room, ways, volume, most)
    own = root * whole.share[len(radius) :] ** power
    return whole, np.concatenate([radius, own])


def _parted(room: Room, ways: Ways, volume: FloatArray, most: float) -> TrunkLines:
    """Lines with more perforators beside those that feed too much; shares are measured.

    Parameters
    ----------
    most : float
        Of its tree's share, that a perforator is to feed at most.
    """
    while True:
        whole = with_shares(room.lines(), volume)
        path = _beside(room, ways, np.flatnonzero(room.served_by_full(whole, ways, most)))
        if path is None:
            return whole
        ways.take(pieces_along(path[:-1], path[1:], room.need_mm)[0])


def _beside(room: Room, ways: Ways, sites: IntArray) -> FloatArray | None:
    """A perforator that is laid to the farthest of ``sites`` (k,) to which one fits, if any."""
    while len(sites := sites[ways.away[sites] > _CROWDED * room.need_mm]):
        site = int(sites[np.argmax(ways.away[sites])])
        path = room.path_to(ways, site)
        if path is not None:
            return path
        ways.leave(site, _CROWDED * ways.away[site])
    return None
