"""Load lumens for a dye front prediction; write arrival times, concentration curves, a picture.

Goes in: a network or a run. Comes out: arrival of dye, as files. Begin with `outputs.py`.
"""

from printctl.dye.outputs import CURVES, FRONT, PICTURE, Place, write_front
from printctl.dye.source import Lumens, lumens_of

__all__ = ["CURVES", "FRONT", "PICTURE", "Lumens", "Place", "lumens_of", "write_front"]
