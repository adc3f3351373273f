"""Dye front in a print: video against 0D flow, for arrival times and patency of each vessel.

Goes in: a video, the user's marks, a network. Comes out: arrivals and the state of each vessel.
Begin with `measure.py`.
"""

from registration.dye.marks import Marks, read_marks
from registration.dye.measure import DyeOptions, DyeReport, measure_dye
from registration.dye.numbers import dye_dict, place_rows
from registration.dye.verdict import dye_verdict

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
