"""Grow an organ's trees; where they don't fit, try fewer or narrower vessels before advising so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil, floor, log10
from typing import Final

from design.anatomy.grown import AnatomicTrees
from design.errors import CrowdedError, GrowthError, NoRoomError
from design.units import PA_PER_MMHG
from design.vasculature.options import GrowthOptions

_TRIED: Final = (1.0, 0.7)
"""Of the terminals that fit; fewer terminals have other trunks, and mayn't fit either."""
_NARROWER: Final = (1.0, 4.0, 8.0)
"""Least factors on the pressure drop, each over the one before, of the narrower vessels tried."""
_NEARER: Final = (0.5, 0.2)
"""Parts of the clearance that are tried where narrower vessels don't help."""


def grow_or_advise(
    grow: Callable[[GrowthOptions], AnatomicTrees],
    options: GrowthOptions,
    least: int,
    tried: Callable[[GrowthOptions], AnatomicTrees] | None = None,
) -> AnatomicTrees:
    """Return what ``grow`` makes of the options.

    Parameters
    ----------
    grow : function of options
    options : GrowthOptions
    least : int
        Terminals that the template takes at least.
    tried : function of options, optional
        A shorter ``grow`` that succeeds only where that would; ``grow`` itself by default.

    Raises
    ------
    CrowdedError
        Naming a smaller number only where that was grown.
    NoRoomError
        Naming a higher pressure drop, or a smaller diameter, only where that was grown.
    TissueError, GrowthError
        As ``grow``.
    """
    try:
        return grow(options)
    except CrowdedError as crowded:
        raise _with_fewer(crowded, tried or grow, options, least) from crowded
    except NoRoomError as narrow:
        raise _with_narrower(narrow, tried or grow, options) from narrow


def _with_fewer(
    crowded: CrowdedError,
    grow: Callable[[GrowthOptions], AnatomicTrees],
    options: GrowthOptions,
    least: int,
) -> CrowdedError:
    """The error, with what came of fewer terminals."""
    counts: list[int] = []
    for part in _TRIED:
        fewer = int(part * crowded.fit)
        if fewer < least:
            break
        counts.append(fewer)
        if _fits(grow, replace(options, terminals=fewer)) is None:
            return crowded.with_fewer(counts, least, grown=True)
    narrower = options
    for factor in _NARROWER[1:]:
        narrower, value = _narrower(narrower, factor)
        if _fits(grow, narrower) is None:
            return crowded.with_fewer(counts, least, narrower=f"{_key(options)} of {value}")
    return crowded.with_fewer(counts, least)


def _with_narrower(
    narrow: NoRoomError, grow: Callable[[GrowthOptions], AnatomicTrees], options: GrowthOptions
) -> NoRoomError:
    """The error, with what came of narrower vessels and, where they don't help, of less room."""
    key = _key(options)
    way = "less" if options.smallest_radius_mm else "more (radii fall by its fourth root)"
    failed, narrower = narrow, options
    values: list[str] = []
    for least in _NARROWER:
        narrower, value = _narrower(narrower, max(least, failed.drop_factor))
        values.append(value)
        error = _fits(grow, narrower)
        if error is None:
            return narrow.with_remedy(f"give a {key} of {value} or {way}, which was tried and fits")
        if not error.nearer_than(failed):
            break
        failed = error
    tried = f"{key} of {' and '.join(values)}"
    for part in _NEARER:
        clearance = _rounded(part * options.clearance_mm, floor)
        tried += f", clearance_mm of {clearance:g}"
        if _fits(grow, replace(options, clearance_mm=clearance)) is None:
            return narrow.with_remedy(
                f"give a clearance_mm of {clearance:g} or less, which was tried and fits"
            )
    return narrow.with_remedy(
        f"neither narrower vessels nor less room between them fit ({tried} were tried): take fewer "
        "terminals or a larger tissue"
    )


def _key(options: GrowthOptions) -> str:
    """Which key of a recipe makes vessels narrower."""
    return "smallest_diameter_mm" if options.smallest_radius_mm else "pressure_drop_mmhg"


def _narrower(options: GrowthOptions, drop_factor: float) -> tuple[GrowthOptions, str]:
    """The options with narrower vessels, and the value that a recipe gives for it."""
    if options.smallest_radius_mm is not None:
        diameter = _rounded(2.0 * options.smallest_radius_mm * drop_factor**-0.25, floor)
        narrower = replace(options, smallest_radius_mm=diameter / 2)
        return narrower, f"{diameter:g}"
    drop = _rounded(options.pressure_drop_pa / PA_PER_MMHG * drop_factor, ceil)
    narrower = replace(options, pressure_drop_pa=drop * PA_PER_MMHG)
    return narrower, f"{drop:g}"


def _rounded(value: float, towards: Callable[[float], int]) -> float:
    """To two digits; 0 stays."""
    if value <= 0.0:
        return 0.0
    step = 10.0 ** (floor(log10(value)) - 1)
    # What is round already stays, whatever its last bit.
    return float(f"{towards(round(value / step, 6)) * step:.3g}")


def _fits(
    grow: Callable[[GrowthOptions], AnatomicTrees], options: GrowthOptions
) -> NoRoomError | None:
    """None where it grows, else why not."""
    try:
        grow(options)
    except NoRoomError as error:
        return error
    except GrowthError as error:
        return NoRoomError(str(error))
    return None
