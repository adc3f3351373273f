"""Ink of a printer whose only head is a pneumatic one."""

from firmware_profiles import Printer
from gcode.deposit.lay import EXACT_MM, Deposit, deposit, valves_as_plungers
from gcode.motion.executed import ExecutedMotion


def pneumatic_deposit(
    executed: ExecutedMotion, gcode: bytes, printer: Printer, flow_ul_s: float, voxel_mm: float
) -> Deposit:
    """Lay the ink of a printer's only valve."""
    (motion,) = valves_as_plungers(executed, gcode, printer, [flow_ul_s])
    return deposit(motion, 1.0, voxel_mm, smoothing_mm=EXACT_MM, plunger_step_mm=EXACT_MM)
