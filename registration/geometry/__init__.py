"""Part frame on datums (ISO 5459), and geometric characteristics measured in it (ISO 1101).

Names are loaded when first asked for: a recipe needs the datums' names alone.

Goes in: scanned faces and sections. Comes out: a frame, and zones of vessels and faces. Begin with
`measure.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.geometry.characteristic import Characteristic
    from registration.geometry.datum import Datum, read_datums
    from registration.geometry.designed import check_designed
    from registration.geometry.faces import Face, outer_faces
    from registration.geometry.frame import Frame, best_fit
    from registration.geometry.lay_frame import lay_on_datums
    from registration.geometry.measure import characteristics, cuts_of
    from registration.geometry.scene import Cut, Scene

__all__ = [
    "Characteristic",
    "Cut",
    "Datum",
    "Face",
    "Frame",
    "Scene",
    "best_fit",
    "characteristics",
    "check_designed",
    "cuts_of",
    "lay_on_datums",
    "outer_faces",
    "read_datums",
]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
