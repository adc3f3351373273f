"""Correct a design's geometry by deviations of earlier prints: scale, lumens, positions.

Goes in: a design and corrections. Comes out: the corrected design. Begin with `corrections.py`.
"""

from design.toolpath.correction.checks import check_outside, check_walls
from design.toolpath.correction.corrections import NEUTRAL, Corrections
from design.toolpath.correction.stretch import Stretch

__all__ = ["NEUTRAL", "Corrections", "Stretch", "check_outside", "check_walls"]
