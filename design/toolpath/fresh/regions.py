"""Divide each layer's section among regions with their own infill or their own head."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from manifold3d import CrossSection, Manifold

from design.solids.solid import Solid
from design.toolpath.fresh.options import Compensation, Filling
from design.toolpath.fresh.section import manifold_of


@dataclass(frozen=True)
class Region:
    """A body inside which the part is filled in another way, or written by another head.

    Without a head walls go on through it: they follow the part's own boundary. What a head writes
    is a section of its own, with walls on both sides of the border: their edges meet there.

    Attributes
    ----------
    solid : Solid
        In the part's frame; where it reaches out of the part nothing is written.
    filling : Filling
    head : int or None
        Which head writes here; None leaves that to the regions before, and head 0 without any.
    """

    solid: Solid
    filling: Filling
    head: int | None = None


@dataclass(frozen=True)
class RegionSections:
    """Regions at one height; where several overlap, the last counts.

    Attributes
    ----------
    regions : tuple of (CrossSection, Region)
        As they were given.
    """

    regions: tuple[tuple[CrossSection, Region], ...]

    def shares(
        self, inside: CrossSection, filling: Filling
    ) -> Iterator[tuple[CrossSection, Filling]]:
        """Part ``inside`` among the regions' fillings; the rest has ``filling``."""
        for section, region in reversed(self.regions):
            share = inside ^ section
            if not share.is_empty():
                yield share, region.filling
                inside = inside - section
        yield inside, filling

    def sections(self, material: CrossSection) -> dict[int, CrossSection]:
        """What each head writes of ``material``, those without any left out."""
        by_head: dict[int, CrossSection] = {}
        for section, region in reversed(self.regions):
            if region.head is None:
                continue
            share = material ^ section
            if not share.is_empty():
                before = by_head.get(region.head)
                by_head[region.head] = share if before is None else before + share
                material = material - section
        if not material.is_empty():
            by_head[0] = material if 0 not in by_head else by_head[0] + material
        return by_head


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
        self._bodies: list[tuple[Manifold, Region]] = [
            (manifold_of(compensation.enlarged(region.solid), f"region {number}"), region)
            for number, region in enumerate(regions)
        ]

    def at(self, z_mm: float) -> RegionSections:
        """The regions' sections at a height."""
        return RegionSections(tuple((body.slice(z_mm), region) for body, region in self._bodies))
