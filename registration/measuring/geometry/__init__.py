"""Part frame on datums (ISO 5459), and geometric characteristics measured in it (ISO 1101).

Names are loaded when first asked for: a recipe needs the datums' names alone.

Goes in: scanned faces and sections. Comes out: a frame, and zones of vessels and faces. Begin with
`zones.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.measuring.geometry.datum import Datum, read_datums
    from registration.measuring.geometry.faces import Face, outer_faces
    from registration.measuring.geometry.frame import Frame, best_fit
    from registration.measuring.geometry.lay_frame import lay_on_datums
    from registration.measuring.geometry.scene import Cut, Scene, check_designed
    from registration.measuring.geometry.zones import Characteristic, characteristics, cuts_of

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

__getattr__, __dir__ = on_demand(__name__)
