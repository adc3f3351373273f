"""Choose the pressure lag: the user's, or the ink's for this syringe and needle, or 0 s."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from firmware_profiles import Ink, Needle, Syringe

How = Literal["measured", "given", "unknown"]


@dataclass(frozen=True)
class ChosenLag:
    """Chosen pressure lag and its origin.

    Attributes
    ----------
    seconds : float, s
        0 where it isn't known.
    how : "measured", "given" or "unknown"
        By `printctl calibrate lag`, by the user for this once, or not at all.
    note : str
        What to tell about it; empty for a measured one.
    """

    seconds: float
    how: How
    note: str = ""


def lag_of(ink: Ink, syringe: Syringe, needle: Needle | None, given_s: float | None) -> ChosenLag:
    """Take the user's lag, else the ink's own if it was measured with this syringe and needle."""
    if given_s is not None:
        return ChosenLag(given_s, "given", f"the lag of {given_s:g} s was given, not measured here")
    own = ink.lag
    if own is None:
        return ChosenLag(
            0.0,
            "unknown",
            f"nobody measured how {ink.name}'s flow lags (printctl calibrate lag): predicted "
            "without a lag; --lag-s tries one",
        )
    mounted = (syringe.name, needle.name if needle else "no needle named")
    if (own.syringe, own.needle) != mounted:
        return ChosenLag(
            0.0,
            "unknown",
            f"the lag of {ink.name} was measured with {own.syringe} and {own.needle}, and "
            f"{mounted[0]} and {mounted[1]} are mounted: predicted without a lag; measure it again",
        )
    return ChosenLag(own.lag_s, "measured")
