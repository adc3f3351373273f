"""Calibrate machine and ink: write test prints, fit constants with intervals, correct profiles.

Goes in: readings as CSV. Comes out: constants with intervals, test prints, corrected profiles.
Begin with `results.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.calibration.estimate import Estimate
    from printctl.calibration.lag import Lag, LagPattern, fit_lag
    from printctl.calibration.paths import backlash_path, lag_path, weighing_path
    from printctl.calibration.readings import Readings, read_readings
    from printctl.calibration.results import (
        backlash_result,
        level_result,
        offset_result,
        weighing_of,
        weighing_result,
    )
    from printctl.calibration.touches import (
        Backlash,
        Level,
        fit_backlash,
        fit_level,
        fit_offset,
        gap_between,
    )
    from printctl.calibration.weighing import FlowWeighing, Weighing, fit_flow, fit_weighing
    from printctl.calibration.writing import Job, make_test, measured_key, save_measured

__all__ = [
    "Backlash",
    "Estimate",
    "FlowWeighing",
    "Job",
    "Lag",
    "LagPattern",
    "Level",
    "Readings",
    "Weighing",
    "backlash_path",
    "backlash_result",
    "fit_backlash",
    "fit_flow",
    "fit_lag",
    "fit_level",
    "fit_offset",
    "fit_weighing",
    "gap_between",
    "lag_path",
    "level_result",
    "make_test",
    "measured_key",
    "offset_result",
    "read_readings",
    "save_measured",
    "weighing_of",
    "weighing_path",
    "weighing_result",
]

__getattr__ = on_demand(__name__)
