"""Calibrate machine and ink: write test prints, fit constants with intervals, correct profiles.

Goes in: readings as CSV. Comes out: constants with intervals, test prints, corrected profiles.
Begin with `results.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.calibration.estimate import Estimate
    from printctl.calibration.lag import Lag, LagPattern, fit_lag
    from printctl.calibration.paths import (
        CalibrationTest,
        backlash_test,
        lag_test,
        weighing_test,
    )
    from printctl.calibration.readings import Readings, read_readings
    from printctl.calibration.touches import (
        Backlash,
        Level,
        fit_backlash,
        fit_level,
        fit_offset,
        gap_between,
    )
    from printctl.calibration.weighing import FlowWeighing, Weighing, fit_flow, fit_weighing

__all__ = [
    "Backlash",
    "CalibrationTest",
    "Estimate",
    "FlowWeighing",
    "Lag",
    "LagPattern",
    "Level",
    "Readings",
    "Weighing",
    "backlash_test",
    "fit_backlash",
    "fit_flow",
    "fit_lag",
    "fit_level",
    "fit_offset",
    "fit_weighing",
    "gap_between",
    "lag_test",
    "read_readings",
    "weighing_test",
]

__getattr__ = on_demand(__name__)
