"""Time limit for living cells in the ink, from recipe or ink profile; none if neither has one."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Ink


@dataclass(frozen=True)
class Budget:
    """Time limit of the cells.

    Attributes
    ----------
    minutes : float, min
    source : str
        Where the number comes from.
    key : str
        Where it was said.
    refuses : bool
        Whether a longer print is refused: where the user said it for this print, or the ink was
        measured.
    """

    minutes: float
    source: str
    key: str
    refuses: bool


def budget_of(ink: Ink, minutes: float | None = None, source: str | None = None) -> Budget | None:
    """The recipe's budget where it says one, else the ink's; None where nobody knows."""
    if minutes is not None and source is not None:
        return Budget(minutes, source, "printer.care.viability_min", True)
    if ink.viability_min is None or ink.viability_source is None:
        return None
    key = f"{ink.name}: viability_min"
    return Budget(ink.viability_min, ink.viability_source, key, ink.calibrated)
