"""Measure a picture of a printed pattern: its position, line widths and gaps.

Goes in: a picture and a pattern. Comes out: widths and gaps, mm. Begin with `view.py`.
"""

from registration.devices.microscope.annotate import annotated
from registration.devices.microscope.ink_absorption import Shade
from registration.devices.microscope.picture import Target, View, read_picture
from registration.devices.microscope.view import find_view, marked_view
from registration.devices.microscope.widths import (
    Crossing,
    GapWidth,
    Line,
    LineWidths,
    measure_gaps,
    measure_lines,
)

__all__ = [
    "Crossing",
    "GapWidth",
    "Line",
    "LineWidths",
    "Shade",
    "Target",
    "View",
    "annotated",
    "find_view",
    "marked_view",
    "measure_gaps",
    "measure_lines",
    "read_picture",
]
