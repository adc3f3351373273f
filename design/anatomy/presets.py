"""Default Murray exponent, pressure drop and number of trunk ends of each organ template."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from design.errors import LEAST_TERMINALS, GrowthError


@dataclass(frozen=True)
class Preset:
    """Growth by a template.

    Attributes
    ----------
    murray_exponent : float
    pressure_drop_mmhg : float
        From the inlet to the terminals; sets how slender vessels are.
    """

    murray_exponent: float
    pressure_drop_mmhg: float


PRESETS: Final = {
    # Between Murray's 3 and the 7/3 that Huo and Kassab find in coronary casts (PMC4913552). With
    # 7.3 mmHg elements are as slender as those of Kassab et al. 1993 (measures/published/).
    "heart": Preset(2.5, 7.3),
    # Nordsletten et al. 2006 find Murray's law. The drop is ours: no figure was confirmed.
    "kidney": Preset(3.0, 20.0),
    # Of the portal vein, to its terminals. Ours: no figure of these was confirmed.
    "liver": Preset(3.0, 5.0),
    # Helthuis et al. 2019 (Anat Rec 302:1434, PMC6767475) find Murray's law in human cerebral
    # arteries of 0.1 to 1 mm radius. The drop is ours.
    "cortex": Preset(3.0, 20.0),
}


# Limit the number of an organ's trunk ends by its number of terminals; refuse too few.

_FEWEST: Final = 6


def trunk_ends(wanted: int, terminals: int, organ: str, least: int = LEAST_TERMINALS) -> int:
    """Return the number of trunk ends: as wanted, or what the terminals are enough for.

    Parameters
    ----------
    wanted : int
        By the recipe.
    terminals : int
    organ : str
        For the message.
    least : int
        Terminals that the template takes at least: as many for each of six ends.

    Raises
    ------
    GrowthError
        For fewer terminals or ends.
    """
    if terminals < least:
        raise GrowthError(
            f"{terminals} terminals are too few for the template of a {organ}; "
            f"ask for {least} at least"
        )
    if wanted < _FEWEST:
        raise GrowthError(
            f"{wanted} trunk_ends are too few for the template of a {organ}; "
            f"ask for {_FEWEST} at least"
        )
    return min(wanted, terminals * _FEWEST // least)
