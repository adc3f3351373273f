"""Dye front in a print: video against 0D flow, for arrival times and patency of each vessel.

Goes in: a video, the user's marks, a network. Comes out: arrivals and the state of each vessel.
Begin with `measure.py`.
"""

from registration.dye.measure import (
    DyeOptions,
    DyeReport,
    dye_dict,
    dye_verdict,
    measure_dye,
    place_rows,
)
from registration.dye.view import Marks, read_marks

__all__ = [
    "DyeOptions",
    "DyeReport",
    "Marks",
    "dye_dict",
    "dye_verdict",
    "measure_dye",
    "place_rows",
    "read_marks",
]
