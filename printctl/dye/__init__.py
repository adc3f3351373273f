"""The front of dye through a network, foreseen, and the files it leaves."""

from printctl.dye.outputs import CURVES, FRONT, PICTURE, Place, write_front
from printctl.dye.source import Lumens, lumens_of

__all__ = ["CURVES", "FRONT", "PICTURE", "Lumens", "Place", "lumens_of", "write_front"]
