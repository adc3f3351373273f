"""Lay a pneumatic head's ink into voxels, by the valve's open time along the path.

The flow is steady while the valve stands open, so a block gets flow times its time: a corner at
which the head slows down gets more. Within one block ink is spread evenly, though the head slows
down at its ends. What flows while the head stands (a valve that opens early or closes late) would
make a drop; the deposit model lays none, and tells its volume as `standing_ul`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_profiles import Printer
from sim.errors import DepositError
from sim.gcode.deposit.ink_faults import NO_FAULTS, InkFaults
from sim.gcode.deposit.lay import Deposit, Style, deposit
from sim.gcode.heads import as_plunger, flowing, read_with_valve, with_commands
from sim.gcode.motion.executed import ExecutedMotion

_EXACT_MM: Final = 1e-6
_KNOWN: Final = 0.9


def pneumatic_deposit(
    executed: ExecutedMotion,
    gcode: bytes,
    printer: Printer,
    flow_ul_s: float,
    voxel_mm: float,
    style: Style | None = None,
    faults: InkFaults = NO_FAULTS,
) -> Deposit:
    """Lay the ink of a pneumatic head's executed motion into voxels.

    Parameters
    ----------
    executed : ExecutedMotion
        What the printer did, from the first move on.
    gcode : bytes
        The file, for when the valve stood open.
    printer : Printer
    flow_ul_s : float, µL/s
        While it does.
    voxel_mm : float, mm
    style : "layered" or "embedded" or None
    faults : InkFaults
        As for `deposit`.

    Raises
    ------
    DepositError
        When the head is no pneumatic one, the motion isn't the file's, nothing is written or the
        grid would be too large.
    """
    head = printer.pneumatic
    if head is None:
        raise DepositError(f"{printer.name} has no pneumatic head (dispenser); use deposit")
    if not (math.isfinite(flow_ul_s) and flow_ul_s > 0):
        raise DepositError(f"flow_ul_s is {flow_ul_s:g}; it must be a number above 0")
    _check_moved(executed)
    x, y, z = executed.start[0].tolist()
    program, valve = read_with_valve(gcode, printer, (x, y, z))
    commanded = with_commands(executed, program)
    _check_same(commanded)
    spans = np.zeros((0, 2)) if valve is None else flowing(commanded, program, valve, head)
    motion = as_plunger(executed, spans, flow_ul_s)
    # What flows is known at every moment: there are no plunger steps to smooth or to bridge.
    return deposit(
        motion,
        1.0,
        voxel_mm,
        smoothing_mm=_EXACT_MM,
        style=style,
        plunger_step_mm=_EXACT_MM,
        faults=faults,
    )


def _check_moved(executed: ExecutedMotion) -> None:
    if not len(executed):
        raise DepositError("nothing moved, so nothing was deposited")


def _check_same(executed: ExecutedMotion) -> None:
    """Whether the motion is that of the file, but for what a host puts in (a pause's lift)."""
    known = float((executed.line >= 0).mean())
    if known < _KNOWN:
        raise DepositError(
            f"only {known:.0%} of the motion is in the G-code, below {_KNOWN:.0%}; they aren't of "
            "the same print: give the file that was printed"
        )
