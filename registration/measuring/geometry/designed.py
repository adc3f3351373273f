"""Refuse datum features that the design lacks, before reading any scan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from design.network import VesselNetwork
from registration.errors import DatumError
from registration.measuring.geometry.datum import Datum
from registration.measuring.geometry.line import Line

MOST_NAMED = 12
"""Mouths that a message names."""


def check_designed(datums: Sequence[Datum], network: VesselNetwork) -> None:
    """Raise if a datum's vessel or mouth isn't in the design, or its axis is curved.

    Raises
    ------
    DatumError
    """
    for datum in datums:
        if datum.kind == "axis":
            straight_axis(datum, network)
        elif datum.kind in ("inlet", "outlet"):
            designed_mouth(datum, network)


def straight_axis(datum: Datum, network: VesselNetwork) -> Line:
    """Return the designed axis that a datum names.

    Raises
    ------
    DatumError
        When there is no such vessel, or it is curved.
    """
    count = network.vessel_count
    if datum.vessel >= count:
        raise DatumError(
            f"datum {datum}: the design has vessels 0 to {count - 1}; name one of those"
        )
    line = Line.of(network, datum.vessel)
    if not line.straight:
        raise DatumError(
            f"datum {datum}: vessel {datum.vessel} is curved by design and has no one axis; name "
            "a straight vessel, or its mouths"
        )
    return line


def designed_mouth(datum: Datum, network: VesselNetwork) -> tuple[int, bool]:
    """Return vessel, and whether its last node, of the mouth that a datum names.

    Raises
    ------
    DatumError
        When no end of the design opens there.
    """
    mouths = designed_mouths(network)
    named = (datum.vessel, datum.kind == "outlet")
    if named not in mouths:
        names = [f"{'outlet' if last else 'inlet'} {v}" for v, last in mouths]
        have = ", ".join(names[:MOST_NAMED]) + (" ..." if len(names) > MOST_NAMED else "")
        raise DatumError(f"datum {datum}: no such mouth in the design; it has {have}")
    return named


def designed_mouths(network: VesselNetwork) -> list[tuple[int, bool]]:
    """Return vessel and whether its last node, of each end that opens."""
    degree = network.degree()[network.vessel_nodes]
    return [(int(v), bool(last)) for v, last in np.argwhere(degree == 1)]
