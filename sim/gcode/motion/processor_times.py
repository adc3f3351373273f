"""Constants: an 8-bit board's processor time to plan a move (block, corner, trapezoid).

Of Marlin bugfix-2.1.x on an ATmega2560 at 16 MHz; measured as `sim.gcode.dry_run.line_times` tells.
"""

from typing import Final

BLOCK_S: Final = 0.92e-3
"""To make a block of a move."""
CORNER_S: Final = 0.63e-3
"""More where another waits: the speed at their corner."""
TRAPEZOID_S: Final = 0.19e-3
"""For each trapezoid that the new block makes the planner set."""
