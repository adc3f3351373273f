"""Data types of a print's set-up: printer, needle, syringe, ink, dish, bath; heads' contents."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Bath, Ink, Needle, Printer, Syringe
from firmware_profiles.tools import THINNEST_BORE
from printctl.checks.set_up.placed_dish import PlacedDish


@dataclass(frozen=True)
class HeadLoading:
    """Syringe, ink and needle of a head; None for an unknown needle."""

    syringe: Syringe
    ink: Ink
    needle: Needle | None


@dataclass(frozen=True)
class SetUp:
    """Mounted parts and filled syringes of a print.

    Attributes
    ----------
    printer : Printer
    syringe : Syringe
    ink : Ink
    needle, bath : Needle, Bath or None
        None where nobody said it.
    standing : PlacedDish or None
        The dish, where it stands and how high it is filled.
    heads : tuple of HeadLoading
        What each of several heads holds; syringe, ink and needle are then the first one's.
    thinnest_bore : float
        Narrowest line allowed, as a part of the needle's bore.
    """

    printer: Printer
    syringe: Syringe
    ink: Ink
    needle: Needle | None = None
    bath: Bath | None = None
    standing: PlacedDish | None = None
    heads: tuple[HeadLoading, ...] = ()
    thinnest_bore: float = THINNEST_BORE

    def load_of(self, number: int) -> HeadLoading:
        """What a head holds; the same in each where nobody said it of each."""
        if number < len(self.heads):
            return self.heads[number]
        return HeadLoading(self.syringe, self.ink, self.needle)
