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
    from printctl.calibration.results import (
        Result,
        backlash_result,
        flow_result,
        head_offset_result,
        lag_result,
        level_result,
        offset_result,
        weighing_result,
    )
    from printctl.calibration.scanner import ScannerCalibration
    from printctl.calibration.touches import (
        Backlash,
        Level,
        fit_backlash,
        fit_level,
        fit_offset,
        gap_between,
    )
    from printctl.calibration.weighing import FlowWeighing, Weighing, fit_flow, fit_weighing
    from printctl.calibration.writing import Job, make_test, record_of_test

__all__ = [
    "Backlash",
    "CalibrationTest",
    "Estimate",
    "FlowWeighing",
    "Job",
    "Lag",
    "LagPattern",
    "Level",
    "Readings",
    "Result",
    "ScannerCalibration",
    "Weighing",
    "backlash_result",
    "backlash_test",
    "fit_backlash",
    "fit_flow",
    "fit_lag",
    "fit_level",
    "fit_offset",
    "fit_weighing",
    "flow_result",
    "gap_between",
    "head_offset_result",
    "lag_result",
    "lag_test",
    "level_result",
    "make_test",
    "offset_result",
    "read_readings",
    "record_of_test",
    "weighing_result",
    "weighing_test",
]

__getattr__, __dir__ = on_demand(__name__)
