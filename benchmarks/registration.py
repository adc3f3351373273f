"""Scan to report: pose, scale, intervals, diameters, defects, dye: ``make bench-registration``.

Scans are a phantom's (`registration_phantom`), made without any of the product's code. ``--only
NAME`` measures a part; ``--quick`` takes a tenth to a
quarter of the cases.
"""

from __future__ import annotations

from benchmarks.command import Job, run
from benchmarks.registration_cloudcompare import cloudcompare_rows
from benchmarks.registration_defects import defect_rows
from benchmarks.registration_dye import dye_rows
from benchmarks.registration_feedback import feedback_rows
from benchmarks.registration_pose import interval_rows, landing_rows
from benchmarks.registration_vessels import diameter_rows, whole_rows

JOBS: dict[str, Job] = {
    "whole": whole_rows,
    "landing": landing_rows,
    "intervals": interval_rows,
    "diameters": diameter_rows,
    "defects": defect_rows,
    "cloudcompare": cloudcompare_rows,
    "feedback": feedback_rows,
    "dye": dye_rows,
}


if __name__ == "__main__":
    run(JOBS, __doc__)
