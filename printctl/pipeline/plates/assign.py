"""Assign recipe variants to a plate's wells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_profiles import Plate
from printctl.errors import RecipeError
from printctl.pipeline.plates.names import expand
from printctl.pipeline.plates.sweep import Point, points
from printctl.recipe.plate import PlatePart


@dataclass(frozen=True)
class Well:
    """A well and what is printed in it.

    Attributes
    ----------
    name : str
    variant : int
        Number of its point of the sweep, from 0.
    point : Point
    copy : int
        Which of the variant's wells it is, from 1.
    """

    name: str
    variant: int
    point: Point
    copy: int

    @property
    def label(self) -> str:
        """For people: what is varied, or which copy."""
        return self.point.label or f"copy {self.copy}"


def assigned(part: PlatePart, plate: Plate) -> list[Well]:
    """Every well that is printed in, in the order in which the recipe names them.

    Neighbouring wells hold different variants: after one of each comes the next copy of each, so
    that what drifts while a plate is printed doesn't fall on one variant alone.

    Raises
    ------
    RecipeError
        For wells that aren't there, or that don't come out even.
    """
    variants = points(part.sweep, part.combine)
    names = _names(part, plate, len(variants))
    return [
        Well(name, k % len(variants), variants[k % len(variants)], k // len(variants) + 1)
        for k, name in enumerate(names)
    ]


def _names(part: PlatePart, plate: Plate, variants: int) -> Sequence[str]:
    if part.wells is None:
        wanted = variants * (part.copies or 1)
        if wanted > len(plate.wells):
            raise RecipeError(
                f"plate: {variants} variants and {part.copies or 1} copies of each make {wanted} "
                f"parts, and {plate.name} has {len(plate.wells)} wells; vary less, or take a "
                "plate with more"
            )
        return plate.wells[:wanted]
    names = list(plate.wells) if part.wells == "all" else expand(part.wells, plate, "plate.wells")
    copies, left = divmod(len(names), variants)
    if left or (part.copies is not None and part.copies != copies):
        wanted = part.copies or max(1, copies)
        raise RecipeError(
            f"plate.wells names {len(names)} wells, and {variants} variants with {wanted} "
            f"{'copies' if wanted > 1 else 'copy'} of each take {wanted * variants}; name so many, "
            "or leave wells out"
        )
    return names


def scanned_wells(part: PlatePart, plate: Plate, wells: Sequence[Well]) -> list[str]:
    """Wells whose scan is held against the design, in the order of ``wells``.

    Raises
    ------
    RecipeError
        For a well in which nothing is printed.
    """
    if part.scanned is None:
        return [wells[0].name]
    printed = [well.name for well in wells]
    if part.scanned == "all":
        return printed
    named = expand(part.scanned, plate, "plate.scanned")
    empty = [name for name in named if name not in printed]
    if empty:
        raise RecipeError(
            f"plate.scanned names {empty[0]}, in which nothing is printed; name some of "
            f"{', '.join(printed[:12])}{' …' if len(printed) > 12 else ''}"
        )
    return [name for name in printed if name in named]
