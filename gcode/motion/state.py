"""State of Marlin's planner and stepper, as records for kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import MOST_HEADS, Axes, Printer

Records = NDArray[np.void]
"""A structured array; the compiled kernels take these."""
Record = Any
"""One row of such an array: its fields are attributes inside a kernel."""

BLOCK: Final = np.dtype(
    [
        ("steps", "i8", (4,)),  # signed, x y z e
        ("events", "i8"),  # of the axis with most steps
        ("millimetres", "f4"),
        ("nominal_speed", "f4"),  # mm/s
        ("nominal_rate", "i8"),  # step events/s
        ("steps_per_mm", "f4"),  # events per mm of path
        ("acceleration_rate", "i8"),  # events/s²
        ("acceleration", "f4"),  # mm/s²
        ("entry_sq", "f4"),  # (mm/s)²
        ("max_entry_sq", "f4"),
        ("min_entry_sq", "f4"),  # which no later plan goes below
        ("least_sq", "f4"),  # at which it begins and ends beside a standstill
        ("recalculate", "b1"),
        ("initial_rate", "i8"),  # events/s
        ("final_rate", "i8"),
        ("accelerate_before", "i8"),  # events
        ("decelerate_start", "i8"),
        ("unit", "f4", (4,)),  # direction, x y z e
        ("line", "i8"),
    ],
    align=True,
)
"""One straight move on its way through the planner."""

PLANNER: Final = np.dtype(
    [
        # facts of the machine
        ("steps_per_mm", "f4", (4,)),
        ("mm_per_step", "f4", (4,)),
        ("max_speed", "f4", (4,)),
        ("max_acceleration", "f4", (4,)),
        ("acceleration", "f4", (3,)),  # while printing, retracting, travelling
        ("junction_deviation", "f4"),
        ("min_segment_us", "f8"),
        ("min_steps", "i8"),
        ("flow", "f4"),  # M221, 1 = as commanded
        ("tool", "i8"),  # the head that E moves
        ("e_steps_per_mm", "f4", (MOST_HEADS,)),
        ("e_max_speed", "f4", (MOST_HEADS,)),
        # the planner
        ("position", "i8", (4,)),  # where the last block that was taken will end, steps
        ("shift", "i8", (4,)),  # physical steps minus `position`'s count (G92 E moves it)
        ("prev_unit", "f4", (4,)),
        ("prev_speed", "f4"),
        ("tail", "i8"),  # index of the oldest block
        ("count", "i8"),  # blocks in the ring, the running one too
        ("trapezoids", "i8"),  # that the last move made the planner set
        ("starved", "b1"),  # the last move found it empty, or was slowed down as it nearly was
        ("merged", "i8"),  # moves below the least steps, taken over by their successors
        # the stepper
        ("running", "b1"),
        ("physical", "i8", (4,)),  # motor steps since power-up, at `run_start`
        ("plungers", "i8", (MOST_HEADS,)),  # those of each head's plunger as it was left
        ("run_start", "f8"),  # s, of the running block
        ("run_end", "f8"),  # s, of the running block or of the last one
        ("deliver_at", "f8"),  # s, before which an idle stepper takes no block
        ("first_pulse", "f8"),  # s, of the first step ever; nan before it
        ("logged", "i8"),  # rows of the log in use
    ],
    align=True,
)
"""The planner's and the stepper's state; times are the printer's own."""

LOG: Final = np.dtype(
    [
        ("start", "i8", (4,)),  # physical steps
        ("end", "i8", (4,)),
        ("time_start", "f8"),
        ("time_end", "f8"),
        ("line", "i8"),
        ("tool", "i8"),
    ],
    align=True,
)
"""One block that really ran, or the part of it that did."""


def _four(axes: Axes) -> tuple[float, float, float, float]:
    return axes.x, axes.y, axes.z, axes.e


def new_planner(printer: Printer, start_mm: tuple[float, float, float]) -> Records:
    """Fresh planner of a printer whose tip stands at ``start_mm``, (1,) of `PLANNER`.

    ``start_mm`` is both what the firmware believes and where the motors' counters begin.
    """
    planner = np.zeros(1, PLANNER)
    state: Any = planner[0]
    state["steps_per_mm"] = _four(printer.steps_per_mm)
    state["max_speed"] = _four(printer.max_speed_mm_s)
    for number in range(printer.head_count):
        one = printer.of_head(number)
        state["e_steps_per_mm"][number] = one.steps_per_mm.e
        state["e_max_speed"][number] = one.max_speed_mm_s.e
    state["steps_per_mm"][3] = state["e_steps_per_mm"][0]
    state["max_speed"][3] = state["e_max_speed"][0]
    state["mm_per_step"] = np.float32(1) / state["steps_per_mm"]
    state["max_acceleration"] = _four(printer.max_acceleration_mm_s2)
    state["acceleration"] = printer.acceleration_mm_s2
    state["junction_deviation"] = printer.junction_deviation_mm
    state["min_segment_us"] = printer.min_segment_time_s * 1e6
    state["flow"] = 1.0
    state["min_steps"] = printer.min_steps_per_segment
    steps = np.rint(np.array(start_mm) * np.asarray(state["steps_per_mm"][:3], dtype=float))
    state["position"][:3] = steps
    state["physical"][:3] = steps
    state["first_pulse"] = np.nan
    return planner


def new_ring(printer: Printer) -> Records:
    """Empty ring of the planner's blocks, (planner_blocks,) of `BLOCK`."""
    return np.zeros(printer.planner_blocks, BLOCK)


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
        """What `gcode.motion.planner.command_time` wants."""
        return np.array(
            [self.command_s, self.block_s, self.interrupt_s, self.pulse_s, self.most_load]
        )


class PlanningTime(NamedTuple):
    """Processor time to plan a move, s.

    Of Marlin bugfix-2.1.x on an ATmega2560 at 16 MHz; measured as `gcode.dry_run.feed` tells.
    """

    block_s: float = 0.92e-3  # To make a block of a move.
    corner_s: float = 0.63e-3  # More where another waits: the speed at their corner.
    trapezoid_s: float = 0.19e-3  # For each trapezoid that the new block makes the planner set.


PLANNING: Final = PlanningTime()
