"""Places with a filling of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from manifold3d import CrossSection, Manifold

from design.solids.solid import Solid
from design.toolpath.fresh.compensate import Compensation
from design.toolpath.fresh.options import Filling
from design.toolpath.fresh.section import manifold_of


@dataclass(frozen=True)
class Region:
    """A body inside which the part is filled in another way.

    Walls go on through it: they follow the part's own boundary.

    Attributes
    ----------
    solid : Solid
        In the part's frame; where it reaches out of the part nothing is written.
    filling : Filling
    """

    solid: Solid
    filling: Filling


class Regions:
    """Regions as they are written, ready to be cut level by level.

    Parameters
    ----------
    regions : sequence of Region
        Where several overlap, the last counts.
    compensation : Compensation
        The part's own: they grow with it.

    Raises
    ------
    ToolpathError
        When a region isn't a closed manifold.
    """

    def __init__(self, regions: Sequence[Region], compensation: Compensation) -> None:
        self._bodies: list[tuple[Manifold, Filling]] = [
            (manifold_of(compensation.enlarged(region.solid), f"region {number}"), region.filling)
            for number, region in enumerate(regions)
        ]

    def shares(
        self, inside: CrossSection, z_mm: float, filling: Filling
    ) -> Iterator[tuple[CrossSection, Filling]]:
        """Part ``inside`` at a height among the regions; the rest has ``filling``."""
        for body, own in reversed(self._bodies):
            section = body.slice(z_mm)
            share = inside ^ section
            if not share.is_empty():
                yield share, own
                inside = inside - section
        yield inside, filling
