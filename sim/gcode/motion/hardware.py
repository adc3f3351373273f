"""Constants of a simulated ATmega2560 board: processing times, sensors wired, bed slope."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Board:
    """How fast an ATmega2560 at 16 MHz is, from the recorded transcripts.

    Attributes
    ----------
    command_s : float
        For one command while the motors stand.
    block_s : float
        More, for each block that the planner holds.
    interrupt_s, pulse_s : float
        Of the stepper's interrupt, once and for each pulse in it; the main thread waits for it.
    most_load : float
        Largest share of the processor that the interrupt gets.
    thermistors : bool
        Whether the temperature inputs are wired; without, a heater ends in a MINTEMP stop.
    levels_after_homing : bool
        Whether Marlin was built with ENABLE_LEVELING_AFTER_G28: G28 switches levelling on.
    bed_slope : float
        Of the bed that levelling knows, mm of Z for each mm of X.
    store_s : float
        To write the settings' 597 bytes into the EEPROM, 3.4 ms each; nothing else is done then.
    """

    command_s: float = 1.0e-3
    block_s: float = 95e-6
    interrupt_s: float = 55e-6
    pulse_s: float = 27.5e-6
    most_load: float = 0.9
    thermistors: bool = True
    levels_after_homing: bool = False
    bed_slope: float = 0.0
    store_s: float = 2.03

    def costs(self) -> NDArray[np.float64]:
        """What `sim.gcode.motion.planner.command_time` wants."""
        return np.array(
            [self.command_s, self.block_s, self.interrupt_s, self.pulse_s, self.most_load]
        )


# Constants: an 8-bit board's processor time to plan a move (block, corner, trapezoid).
#
# Of Marlin bugfix-2.1.x on an ATmega2560 at 16 MHz; measured as `sim.gcode.dry_run.feed`
# tells.

BLOCK_S: Final = 0.92e-3
"""To make a block of a move."""
CORNER_S: Final = 0.63e-3
"""More where another waits: the speed at their corner."""
TRAPEZOID_S: Final = 0.19e-3
"""For each trapezoid that the new block makes the planner set."""
