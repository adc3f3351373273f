"""Compose the error message for tree growth that runs out of room."""

from __future__ import annotations

from design.errors import NoRoomError
from design.vasculature.growth.clearances import Clearances
from design.vasculature.growth.step import Scale
from design.vasculature.options import GrowthOptions


def out_of_room_error(
    terminals: int,
    options: GrowthOptions,
    scale: Scale,
    room: Clearances,
    patience: int,
    begun: int = 0,
) -> NoRoomError:
    """The error that says how many terminals fit, and what might help; a trunk had ``begun``."""
    smallest = options.smallest_radius_mm
    wide = f" of radius {smallest:g} mm or more" if smallest else ""
    asked, root = scale.goal, scale.root_radius
    reserved = (
        f" beside a trunk from {root:.3g} mm radius, reserved because {asked} terminals need it"
    )
    limits = ", milder limits on angles or flows" if room.limits.on else ""
    hint = " (their thinner trunk leaves more room: more than here may then fit)"
    # Without a smallest radius all radii follow from the drop, and fewer terminals have as wide
    # a trunk.
    narrower = "a smaller smallest radius" if smallest else "a higher pressure drop"
    return NoRoomError(
        f"only {terminals} of {asked} terminals{wide} fit with clearance "
        f"{room.clearance:g} mm{reserved if root else ''}: {patience} points in a "
        "row found no place",
        f"ask for {narrower} (narrower vessels), fewer "
        f"terminals{hint if root else ''} or a smaller clearance{limits}",
        placed=terminals - begun,
    )
