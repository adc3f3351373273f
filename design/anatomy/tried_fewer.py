"""Grow an organ's trees; where they don't fit, try fewer terminals before advising fewer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from design.anatomy.grown import AnatomicTrees
from design.errors import CrowdedError, GrowthError

_TRIED: Final = (1.0, 0.7)
"""Of the terminals that fit; fewer terminals have other trunks, and mayn't fit either."""


def grow_or_advise(
    grow: Callable[[int], AnatomicTrees], terminals: int, least: int
) -> AnatomicTrees:
    """Return what ``grow`` makes of so many terminals.

    Parameters
    ----------
    grow : function of the number of terminals
    terminals, least : int
        Asked for; and what the template takes at least.

    Raises
    ------
    CrowdedError
        Naming a smaller number only where that was grown.
    TissueError, GrowthError
        As ``grow``.
    """
    try:
        return grow(terminals)
    except CrowdedError as crowded:
        tried: list[int] = []
        for part in _TRIED:
            fewer = int(part * crowded.fit)
            if fewer < least:
                break
            tried.append(fewer)
            try:
                grow(fewer)
            except GrowthError:
                continue
            raise crowded.with_fewer(tried, least, grown=True) from crowded
        raise crowded.with_fewer(tried, least) from crowded
