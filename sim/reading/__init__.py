"""Reading of G-code, one way for all: what leaves is rendered from what was understood.

`read_line` reads one line as the printer's firmware family reads it, or refuses it with the reason.
Pure Python, without compiled kernels, so that the printer link can import it at no cost.
"""

from sim.reading.line import BLANK, GcodeLine
from sim.reading.read import read_line

__all__ = ["BLANK", "GcodeLine", "read_line"]
