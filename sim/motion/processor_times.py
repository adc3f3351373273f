"""Constants: an 8-bit board's processor time to read a line and to plan a move.

Of Marlin bugfix-2.1.x on an ATmega2560 at 16 MHz; measured as `sim.dry_run.line_times` tells.
"""

from typing import Final

LINE_S: Final = 0.06e-3
"""To read a line, besides its bytes."""
BYTE_S: Final = 15.5e-6
MOVE_S: Final = 0.34e-3
"""More for a line that is a move."""
BLOCK_S: Final = 0.92e-3
"""To make a block of a move."""
CORNER_S: Final = 0.63e-3
"""More where another waits: the speed at their corner."""
TRAPEZOID_S: Final = 0.19e-3
"""For each trapezoid that the new block makes the planner set."""
