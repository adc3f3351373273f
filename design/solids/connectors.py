"""Build solids of tubing and syringe fittings, and join one with its bore to a body."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.frames import vectors_across
from design.solids.connector import Connector, profiles
from design.solids.facets import FACET_TOLERANCE_MM, area_factor, facet_count
from design.solids.manifolds import solid_manifold, subtract, unite
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid


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
    """``body`` with a fitting at a port, and its bore taken out of both.

    Parameters
    ----------
    body : Solid
    connector : Connector
    at : (3,) float64, mm
        Where the port's axis meets the body's face.
    outward : (3,) float64
        Out of the body; any length.
    lead_in_mm : float, mm
        By how much the outside begins within the body, so that a curved face leaves no gap.
    through_mm : float, mm
        How deep within the body the bore begins.

    Raises
    ------
    SolidError
        When the fitting can't be made, or ``outward`` has no length.
    """
    length = float(np.linalg.norm(outward))
    if not length > 0.0:
        raise SolidError("outward has no length; give the direction out of the body")
    outside, bore = connector_parts(connector, through_mm, lead_in_mm)
    frame = _frame(np.asarray(outward, dtype=np.float64) / length)
    placed = [
        part.transform(np.column_stack([frame, at]))
        for part in (
            solid_manifold(outside, "the fitting"),
            solid_manifold(bore, "the fitting's bore"),
        )
    ]
    whole = unite([solid_manifold(body, "the body"), placed[0]])
    return solid_from_manifold(subtract(whole, [placed[1]]), "the body with its fitting")


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
