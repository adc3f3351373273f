"""Measure a picture of a printed pattern: its position, line widths and gaps.

Goes in: a picture and a pattern. Comes out: widths and gaps, mm. Begin with `view.py`.
"""

from registration.microscope.annotate import annotated
from registration.microscope.gaps import Crossing, GapWidth, measure_gaps
from registration.microscope.ink_absorption import Shade, shade_profile
from registration.microscope.picture import Picture, read_picture
from registration.microscope.target import Target, View
from registration.microscope.view import find_view, marked_view
from registration.microscope.widths import Line, LineWidths, measure_lines

__all__ = [
    "Crossing",
    "GapWidth",
    "Line",
    "LineWidths",
    "Picture",
    "Shade",
    "Target",
    "View",
    "annotated",
    "find_view",
    "marked_view",
    "measure_gaps",
    "measure_lines",
    "read_picture",
    "shade_profile",
]
