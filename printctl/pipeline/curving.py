"""Replace bends of grown trees by smooth curves within the tissue (recipe key `curves`)."""

from __future__ import annotations

from dataclasses import replace

from design.anatomy.fit_apart import KINK, curve_trees, kinks
from design.errors import GrowthError
from design.tissue import Tissue
from design.vasculature import GrownParts
from printctl.recipe.growth import GrownNetwork


def curved(tissue: Tissue, grown: GrownParts, part: GrownNetwork) -> GrownParts:
    """The same trees with curves in the place of bends, clear of each other and in the tissue.

    Main lines go through joints without a kink; a curve that would come too near to another vessel
    or leave the tissue is made shorter. Terminals stay where they are, and flows as they were:
    radii are derived anew from the curves' lengths. A note says how many sharp turns were there
    before and are left.

    Raises
    ------
    GrowthError
        When even the shortest curves have no room.
    """
    trees, (pairs, outside) = curve_trees(
        tissue, grown.trees, part.clearance_mm, part.clearance_ratio
    )
    if pairs or len(outside):
        raise GrowthError(
            f"curves: {len(pairs)} pairs of vessels would come nearer than the clearance and "
            f"{len(outside)} pieces leave the tissue; leave curves out, or grow with more "
            "clearance_mm"
        )
    before, after = (kinks(some, of_root=0.0) for some in (grown.trees, trees))
    note = f"turns of main lines by more than {KINK:g} degrees: {before} as grown, {after} curved"
    return replace(grown, trees=trees, notes=(*grown.notes, note))
