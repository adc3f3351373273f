"""Predict the dye front through a network, and write its files."""

from printctl.dye.outputs import CURVES, FRONT, PICTURE, Place, write_front
from printctl.dye.source import Lumens, lumens_of

__all__ = ["CURVES", "FRONT", "PICTURE", "Lumens", "Place", "lumens_of", "write_front"]
