"""Dimensions of tubing and Luer fittings, and of an open bioreactor chamber."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from design.errors import SolidError

Kind = Literal["plain", "barb", "luer_female", "luer_male"]


class LuerCone(NamedTuple):
    """A Luer fitting's cone, ISO 80369-7, annex B."""

    taper: float = 0.06  # Loss of diameter per length
    opening_mm: float = 4.2925  # Diameter of a socket's mouth
    max_bore: float = 0.85  # Of a socket, over its mouth: the rest is its bottom
    tip_mm: float = 3.9575  # Diameter of a male cone's tip, and of its bore at most
    tip_bore_mm: float = 2.9
    length_mm: float = 7.5  # Of either at least, and of a male one at most
    max_length_mm: float = 10.5


LUER: Final = LuerCone()
BORE_BEYOND_MM: Final = 1.0
"""How far a bore is cut beyond its fitting's end, so that no skin closes it."""


@dataclass(frozen=True)
class Connector:
    """A fitting at a port.

    Attributes
    ----------
    kind : "plain", "barb", "luer_female" or "luer_male"
    bore_mm : float, mm
        Diameter of the channel through it; a Luer socket narrows to it at its bottom.
    outer_mm : float, mm
        Outer diameter of the plain tube, of the barb's shank and of the socket's body. A male
        cone has its own.
    length_mm : float, mm
        From the port outwards. A Luer needs at least its cone's 7.5 mm.
    barb_mm : float, mm
        By how much a barb's diameter exceeds its shank's.
    barbs : int
    """

    kind: Kind
    bore_mm: float
    outer_mm: float = 6.5
    length_mm: float = 10.0  # Of either at least, and of a male one at most
    barb_mm: float = 0.8
    barbs: int = 2


def profiles(
    connector: Connector, through_mm: float
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Radius and height along the outside and along the bore, mm."""
    bore, outer, length = 0.5 * connector.bore_mm, 0.5 * connector.outer_mm, connector.length_mm
    outside = [(outer, 0.0), (outer, length)]
    channel = [(bore, -through_mm), (bore, length + BORE_BEYOND_MM)]
    narrowest = outer
    if connector.kind == "barb":
        step, tall = 0.5 * connector.barb_mm, length / max(connector.barbs, 1)
        outside = []
        for k in range(connector.barbs):
            # Sloped towards the tip, square towards the port, so that tubing stays on.
            low, edge, high = k * tall, (k + 0.5) * tall, (k + 1) * tall
            outside += [(outer, low), (outer, edge), (outer + step, edge), (outer, high)]
    elif connector.kind == "luer_female":
        mouth = 0.5 * LUER.opening_mm
        bottom = mouth - 0.5 * LUER.taper * LUER.length_mm
        beyond = mouth + 0.5 * LUER.taper
        deep = length - LUER.length_mm
        channel = [
            (bore, -through_mm),
            (bore, deep),
            (bottom, deep),
            (beyond, length + BORE_BEYOND_MM),
        ]
        narrowest = outer - mouth + bore
    elif connector.kind == "luer_male":
        tip = 0.5 * LUER.tip_mm
        outside = [(tip + 0.5 * LUER.taper * length, 0.0), (tip, length)]
        narrowest = tip
    _check(connector, narrowest)
    return outside, channel


def check_connector(connector: Connector) -> None:
    """Raise `SolidError` when a fitting's lengths leave it no wall, or aren't a Luer's."""
    profiles(connector, 1.0)


def _check(connector: Connector, narrowest: float) -> None:
    if not (connector.bore_mm > 0.0 and connector.length_mm > 0.0 and connector.barb_mm >= 0.0):
        raise SolidError(f"{connector}: give lengths above 0")
    if connector.kind == "barb" and connector.barbs < 1:
        raise SolidError(f"barbs {connector.barbs}; give at least one")
    if connector.kind.startswith("luer") and connector.length_mm < LUER.length_mm:
        raise SolidError(
            f"length_mm {connector.length_mm:g} of a Luer fitting is below {LUER.length_mm} mm "
            "(ISO 80369-7, annex B); make it longer"
        )
    if connector.kind == "luer_male" and not (
        connector.bore_mm <= LUER.tip_bore_mm and connector.length_mm <= LUER.max_length_mm
    ):
        raise SolidError(
            f"a male Luer cone of bore_mm {connector.bore_mm:g} and length_mm "
            f"{connector.length_mm:g} is over {LUER.tip_bore_mm} or {LUER.max_length_mm} mm "
            "(ISO 80369-7, annex B); make it smaller"
        )
    if connector.kind == "luer_female" and connector.bore_mm > LUER.max_bore * LUER.opening_mm:
        raise SolidError(
            f"bore_mm {connector.bore_mm:g} leaves a Luer socket no bottom; at most "
            f"{LUER.max_bore * LUER.opening_mm:.2f} mm"
        )
    if 0.5 * connector.bore_mm >= narrowest:
        raise SolidError(
            f"bore_mm {connector.bore_mm:g} leaves no wall in a {connector.kind} fitting; make "
            "the bore smaller or outer_mm larger"
        )


@dataclass(frozen=True)
class Chamber:
    """A bioreactor's body: an open vessel with a floor, walls and a ledge for a lid.

    Attributes
    ----------
    shape : "block" or "cylinder"
    inner_mm : (3,) floats, mm
        Inner width, depth and height; of a cylinder the width is the diameter and the depth isn't
        used.
    wall_mm, floor_mm : float, mm
    ledge_mm : float, mm
        Width of a step at the top of the wall on which a lid lies; below the wall's. 0 for none.
    ledge_depth_mm : float, mm
        From the rim down to that step.
    """

    shape: Literal["block", "cylinder"]
    inner_mm: tuple[float, float, float]
    wall_mm: float = 2.0
    floor_mm: float = 2.0
    ledge_mm: float = 0.0
    ledge_depth_mm: float = 1.0
