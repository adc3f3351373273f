"""Inspection of a printed layer's picture or height map against its expected lines.

Names are imported on first use.

Goes in: a picture, its frame, expected lines. Comes out: widths along every line, gaps, blobs,
lumens, the layer's shift, or "not seen". Begin with `see.py`, which calls the rooms in this order:
`pictures` (cropped, evenly lit; made from a volume or a height map), `ink` (the layer's shift, and
how much ink lies along each line, on older ink too), `found` (gaps, widths, blobs, lumens).
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.inspection.annotate import annotated
    from printctl.inspection.findings import LayerFindings
    from printctl.inspection.options import SeeingOptions
    from printctl.inspection.pictures.heights.below import VisibleLines
    from printctl.inspection.pictures.heights.height import HeightFrame, height_map
    from printctl.inspection.pictures.heights.orientation import find_better_orientation
    from printctl.inspection.pictures.heights.own_depth import filament_map
    from printctl.inspection.pictures.heights.surface import Surface, surface_of
    from printctl.inspection.see import see_layer
    from printctl.inspection.values import (
        Appearance,
        Blob,
        ExpectedLines,
        Frame,
        Gap,
        Lumen,
        Stations,
        Stretch,
        Unseen,
    )

__all__ = [
    "Appearance",
    "Blob",
    "ExpectedLines",
    "Frame",
    "Gap",
    "HeightFrame",
    "LayerFindings",
    "Lumen",
    "SeeingOptions",
    "Stations",
    "Stretch",
    "Surface",
    "Unseen",
    "VisibleLines",
    "annotated",
    "filament_map",
    "find_better_orientation",
    "height_map",
    "see_layer",
    "surface_of",
]

__getattr__, __dir__ = on_demand(__name__)
