"""Draw PNG pictures of a vessel network, coloured by a quantity, without a browser.

Names are loaded when first asked for.

Goes in: a network and a quantity. Comes out: pixels. Begin with `compose.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from report.picture.camera import DIRECTIONS, View, fitted_camera
    from report.picture.compose import (
        DrivingWave,
        FilmScene,
        PictureOptions,
        draw_picture,
    )
    from report.picture.quantity import (
        FLOW,
        GAUGED,
        Colour,
        Quantity,
        VesselQuantities,
        magnitude,
        quantities,
    )

__all__ = [
    "DIRECTIONS",
    "FLOW",
    "GAUGED",
    "Colour",
    "DrivingWave",
    "FilmScene",
    "PictureOptions",
    "Quantity",
    "VesselQuantities",
    "View",
    "draw_picture",
    "fitted_camera",
    "magnitude",
    "quantities",
]

__getattr__, __dir__ = on_demand(__name__)
