"""Limit the number of an organ's trunk ends by its number of terminals; refuse too few."""

from __future__ import annotations

from typing import Final

from design.errors import LEAST_TERMINALS, GrowthError

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
