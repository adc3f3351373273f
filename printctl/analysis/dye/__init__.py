"""Load lumens for a dye front prediction; write arrival times, concentration curves, a picture.

Goes in: a network or a run. Comes out: arrival of dye, as files. Begin with `outputs.py`.
"""

from printctl.analysis.dye.outputs import CURVES, FRONT, PICTURE, VesselPlace, write_front
from printctl.analysis.dye.source import DyeLumens, lumens_of

__all__ = ["CURVES", "FRONT", "PICTURE", "DyeLumens", "VesselPlace", "lumens_of", "write_front"]
