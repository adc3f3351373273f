"""Mounted needles and filled syringes of a print."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Bath, Ink, Needle, Printer, Syringe
from printctl.set_up.standing import Standing


@dataclass(frozen=True)
class Loaded:
    """What one of several heads holds; the needle is None where nobody said it."""

    syringe: Syringe
    ink: Ink
    needle: Needle | None = None


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
    standing : Standing or None
        The dish, where it stands and how high it is filled.
    heads : tuple of Loaded
        What each of several heads holds; syringe, ink and needle are then the first one's.
    """

    printer: Printer
    syringe: Syringe
    ink: Ink
    needle: Needle | None = None
    bath: Bath | None = None
    standing: Standing | None = None
    heads: tuple[Loaded, ...] = ()

    def load_of(self, number: int) -> Loaded:
        """What a head holds; the same in each where nobody said it of each."""
        if number < len(self.heads):
            return self.heads[number]
        return Loaded(self.syringe, self.ink, self.needle)
