"""Grow a tree to the terminals asked for, or as many as printable lumens and walls allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from design.errors import DesignError, GrowthError
from design.tissue import Tissue
from design.vasculature.growth.root import rooted_at
from design.vasculature.growth.root_search import deep_roots
from design.vasculature.growth.tree import EFFORT, SPREADS, grow_from_root
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree

MIN_SPREAD = 1.1
"""Terminal spread below which growth isn't begun: next to no candidate would do."""

SEARCH_FACTOR = 1.1
"""The largest number of terminals is searched for to within this factor."""


@dataclass(frozen=True)
class PrintableTree:
    """A tree that keeps its smallest lumen and its walls.

    Attributes
    ----------
    tree : VesselTree
    asked, reached : int
        Terminals.
    options : GrowthOptions
        With which it grew, its root among them.
    stopped : str
        Why it isn't larger; empty where all that was asked for was reached.
    """

    tree: VesselTree
    asked: int
    reached: int
    options: GrowthOptions
    stopped: str

    @property
    def note(self) -> str:
        """One sentence for the report; empty where nothing stopped growth."""
        if not self.stopped:
            return ""
        return (
            f"grew {self.reached} of {self.asked} terminals before printability stopped it "
            f"({SEARCH_FACTOR - 1:.0%} more don't fit): {self.stopped}"
        )


def grow_printable(
    tissue: Tissue, options: GrowthOptions, *, widest_radius_mm: float | None = None
) -> PrintableTree:
    """Grow a tree to the terminals asked for, or to as many as its limits leave room for.

    The radius of the root follows from the smallest radius and the number of terminals (Murray's
    law), so that a larger tree isn't a smaller one continued: each size is grown anew. Without a
    root of the user's, the default one is tried first, and then others where the tissue is deep.

    Parameters
    ----------
    tissue : Tissue
    options : GrowthOptions
        With ``smallest_radius_mm``; ``clearance_mm`` is the smallest wall.
    widest_radius_mm : float, optional
        What can be written at most. The root is the widest vessel: a tree is limited in its
        terminals by it, or in how much wider they are than the smallest.

    Raises
    ------
    GrowthError
        When ``smallest_radius_mm`` isn't given or isn't below the widest, or not even one
        terminal fits.
    TissueError
        When the tissue is too thin for even one vessel.
    """
    if options.smallest_radius_mm is None:
        raise GrowthError("a printable tree needs smallest_radius_mm; give the smallest lumen's")
    if widest_radius_mm is not None and not options.smallest_radius_mm < widest_radius_mm:
        raise GrowthError(
            f"smallest_radius_mm {options.smallest_radius_mm:g} isn't below the widest that can be "
            f"written, {widest_radius_mm:g} mm; give a smaller one"
        )
    starts = list(_roots(tissue, options))
    grown, stopped = _grown(tissue, starts, options.terminals, widest_radius_mm)
    if grown is not None:
        return PrintableTree(grown[0], options.terminals, options.terminals, grown[1], "")
    few, many = 0, options.terminals
    best = None
    while many > max(few + 1, SEARCH_FACTOR * few):
        size = max(1, many // 2) if few == 0 else round((few * many) ** 0.5)
        grown, why = _grown(tissue, starts, size, widest_radius_mm)
        if grown is None:
            many, stopped = size, why
            if size == 1:
                break
        else:
            few, best = size, grown
            del starts[1:]  # the root that has shown itself, first since then
    if best is None:
        raise stopped
    return PrintableTree(best[0], options.terminals, few, best[1], str(stopped))


def _roots(tissue: Tissue, options: GrowthOptions) -> Iterator[GrowthOptions]:
    yield options
    if options.root_point_mm is not None:
        return
    for point, way in zip(*deep_roots(tissue, EFFORT.deep_roots, options.seed), strict=True):
        yield rooted_at(options, point, way)


def _grown(
    tissue: Tissue, starts: list[GrowthOptions], terminals: int, widest_mm: float | None
) -> tuple[tuple[VesselTree, GrowthOptions] | None, DesignError]:
    """A tree of so many terminals from the first root that has room for it, or why none has.

    That root comes first from then on.
    """
    why: DesignError = GrowthError("not tried")
    for n, start in enumerate(starts):
        try:
            options = _narrowed(replace(start, terminals=terminals), widest_mm)
            tree = grow_from_root(tissue, options, len(SPREADS))
        except DesignError as error:
            why = error
        else:
            starts.insert(0, starts.pop(n))
            return (tree, options), why
    return None, why


def _narrowed(options: GrowthOptions, widest_mm: float | None) -> GrowthOptions:
    """The options with a terminal spread that keeps the root within ``widest_mm``."""
    if widest_mm is None or options.smallest_radius_mm is None:
        return options
    narrowest = options.smallest_radius_mm * options.terminals ** (1.0 / options.murray_exponent)
    spread = min(options.terminal_spread or max(SPREADS), widest_mm / narrowest)
    if spread < MIN_SPREAD:
        raise GrowthError(
            f"{options.terminals} terminals of radius {options.smallest_radius_mm:g} mm or more "
            f"need a root of some {MIN_SPREAD * narrowest:.3g} mm, and {widest_mm:.3g} mm is the "
            "widest that can be written; ask for fewer terminals or a smaller smallest_diameter_mm"
        )
    if spread >= max(SPREADS):
        return options
    return replace(options, terminal_spread=spread)
