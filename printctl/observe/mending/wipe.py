"""Plan a wipe along sound ink after a patch that frees the needle of its ink thread."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kernels.arrays import FloatArray
from printctl.observe.mending.held_print import WAY_MM
from printctl.observe.mending.needle_way import under_higher_ink
from printctl.observe.mending.patch import Patch
from printctl.observe.mending.stretches import Site

_STATION_MM: Final = 0.1


def wipe_way(patch: Patch, others: Sequence[Patch], site: Site) -> FloatArray:
    """Return the points of a wipe, (k, 3), mm; none without room, or in a bath.

    The way is the patch's path behind it, for `MendOptions.wipe_widths`: up to the path's end, to
    the next patch, and only where no ink of a later layer stands in the needle's way.

    Parameters
    ----------
    patch : Patch
    others : sequence of Patch
        All of the mend.
    site : Site
    """
    path, begin, none = patch.path, patch.to_mm, np.zeros((0, 3))
    wanted = begin + site.options.wipe_widths * float(path.width_mm.max())
    ahead = [one.from_mm for one in others if one.path is path and one.from_mm >= begin]
    end = min([wanted, path.length_mm, *ahead])
    if not site.layered or patch.backwards or end - begin < WAY_MM:
        return none
    along = np.linspace(begin, end, max(2, int((end - begin) / _STATION_MM) + 1))
    held, clearance = site.held, site.options.clearance_mm
    if under_higher_ink(path.at(along), site.ink, held.needle, clearance).any():
        return none
    return path.at(path.cuts(begin, end)[1:])
