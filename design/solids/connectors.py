"""Build solids of tubing and syringe fittings, and join one with its bore to a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.polyline import vectors_across
from design.solids.dimensions import Connector, profiles
from design.solids.manifolds import solid_manifold, subtract, unite
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid
from design.solids.tube import FACET_TOLERANCE_MM, area_factor, facet_count

_WHAT: Final = "the body with its fittings"


@dataclass(frozen=True)
class PlacedConnector:
    """A fitting at a port of a body.

    Attributes
    ----------
    connector : Connector
    at : (3,) float64, mm
        Where the port's axis meets the body's face.
    outward : (3,) float64
        Out of the body; any length.
    lead_in_mm : float, mm
        By how much the outside begins within the body, so that a curved face leaves no gap.
    through_mm : float, mm
        How deep within the body the bore begins.
    name : str
        Identifies the port in messages.
    """

    connector: Connector
    at: NDArray[np.float64]
    outward: NDArray[np.float64]
    lead_in_mm: float = 1.0
    through_mm: float = 1.0
    name: str = "a port"


def connector_parts(
    connector: Connector, through_mm: float = 1.0, lead_in_mm: float = 0.0
) -> tuple[Solid, Solid]:
    """Outside and bore of a fitting that leaves the origin along +z.

    Parameters
    ----------
    connector : Connector
    through_mm : float, mm
        How deep within the body the bore begins: a wall's thickness and a little, to pass it.
    lead_in_mm : float, mm
        How deep within the body the outside begins.

    Returns
    -------
    outside, bore : Solid
        Add the first to the body, then take away the second, which ends 1 mm beyond the
        fitting.

    Raises
    ------
    SolidError
        When the lengths don't make a fitting with a wall.
    """
    if not 0.0 < through_mm < np.inf:
        raise SolidError(f"through_mm {through_mm:g}; give a depth above 0")
    outside, bore = profiles(connector, through_mm)
    if lead_in_mm > 0.0:
        # One piece with the outside: parts that end at the body's face may only touch there.
        outside = [(outside[0][0], -lead_in_mm), *outside]
    return _turned(outside, "the fitting"), _turned(bore, "the fitting's bore")


def with_connector(
    body: Solid,
    connector: Connector,
    at: NDArray[np.float64],
    outward: NDArray[np.float64],
    lead_in_mm: float = 1.0,
    through_mm: float = 1.0,
) -> Solid:
    """``body`` with one fitting; see `with_connectors` and `PlacedConnector`."""
    return with_connectors(body, [PlacedConnector(connector, at, outward, lead_in_mm, through_mm)])


def with_connectors(body: Solid, placed: Sequence[PlacedConnector]) -> Solid:
    """``body`` with fittings at its ports, and their bores taken out of all of it.

    Bores are taken out once all fittings stand: one may overlap the outside of its neighbour.

    Parameters
    ----------
    body : Solid
    placed : sequence of PlacedConnector

    Raises
    ------
    SolidError
        When a fitting can't be made, an ``outward`` has no length, or two bores meet.
    """
    parts = [_placed(one) for one in placed]
    for (one, (_, bore)), (other, (_, second)) in combinations(zip(placed, parts, strict=True), 2):
        if not (bore ^ second).is_empty():
            apart = float(np.linalg.norm(np.subtract(one.at, other.at)))
            raise SolidError(
                f"the fittings at {one.name} and {other.name}, {apart:.3g} mm apart, open into "
                "each other; make their bores smaller, take another kind (a Luer socket is 4.3 mm "
                "wide) or let the vessels end further apart"
            )
    outsides, bores = [outside for outside, _ in parts], [bore for _, bore in parts]
    try:
        return _cut(_joined(body, outsides), bores)
    except SolidError:
        # Fittings that overlap may touch in edges once rounded: one by one they don't.
        for outside in outsides:
            body = _joined(body, [outside])
        for bore in bores:
            body = _cut(body, [bore])
        return body


def _joined(body: Solid, outsides: list[Manifold]) -> Solid:
    whole = unite([solid_manifold(body, _WHAT), *outsides])
    return solid_from_manifold(whole, _WHAT)


def _cut(body: Solid, bores: list[Manifold]) -> Solid:
    return solid_from_manifold(subtract(solid_manifold(body, _WHAT), bores), _WHAT)


def _placed(one: PlacedConnector) -> tuple[Manifold, Manifold]:
    """Outside and bore of a fitting where it stands."""
    length = float(np.linalg.norm(one.outward))
    if not length > 0.0:
        raise SolidError("outward has no length; give the direction out of the body")
    outside, bore = connector_parts(one.connector, one.through_mm, one.lead_in_mm)
    place = np.column_stack([_frame(np.asarray(one.outward, dtype=np.float64) / length), one.at])
    return (
        solid_manifold(outside, "the fitting").transform(place),
        solid_manifold(bore, "the fitting's bore").transform(place),
    )


def _facets(diameter_mm: float) -> int:
    return facet_count(0.5 * diameter_mm, FACET_TOLERANCE_MM)


def _turned(profile: list[tuple[float, float]], what: str) -> Solid:
    """A solid of revolution around z, of the circle's area at each height."""
    facets = _facets(2.0 * max(radius for radius, _ in profile))
    wide = area_factor(facets)
    outline = [(0.0, profile[0][1]), *((wide * r, z) for r, z in profile), (0.0, profile[-1][1])]
    return solid_from_manifold(Manifold.revolve(CrossSection([outline]), facets), what)


def _frame(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed unit vectors as columns, the third of them ``axis``."""
    return np.column_stack([*vectors_across(axis), axis])
