"""Warn if the printed solid has no ports, or not the number of handles of its design."""

from __future__ import annotations


def solid_notes(ports: int, genus: int | None, expected: int) -> tuple[str, ...]:
    """Sentences on a construct without ports, and on handles that differ from the design's.

    Parameters
    ----------
    ports : int
        Free ends at which lumens open.
    genus, expected : int
        Handles of the construct, as read back (None where it can't be told) and by the network
        (`design.solids.genus`).
    """
    notes: tuple[str, ...] = ()
    if ports == 0:
        notes += (
            "no vessel's end opens through the tissue's surface (0 ports): the lumens are closed "
            "cavities, which nothing can be fed into or washed out of; let an inlet and an outlet "
            "reach the surface",
        )
    if genus is not None and genus != expected:
        notes += (
            f"the construct has {genus} handles, the network asks for {expected}: a lumen breaks "
            "through the tissue's surface beside its ends, or vessels merge that the network "
            "keeps apart; flows are those of the network, not of this construct; compare "
            "solid.stl with network.csv, and move or thin the vessels",
        )
    return notes
