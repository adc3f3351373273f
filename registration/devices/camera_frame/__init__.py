"""Calibrate a camera to the printer's frame by a marked dish insert; locate the needle's tip.

Goes in: a lens, pictures of a dish insert, crosses touched or lines printed. Comes out: a
`CameraFrame` (pixels to mm and back, with uncertainty), checks that it still holds, and where the
needle's tip is. Begin with `fit.py`.
"""

from registration.devices.camera_frame.bundle import PrintedPoints, Touch
from registration.devices.camera_frame.check import FrameCheck, check_frame
from registration.devices.camera_frame.fit import (
    Ties,
    fit_frame,
    fit_printed_frame,
    frame_notes,
    merged,
)
from registration.devices.camera_frame.frame import Bath, CameraFrame, read_frame
from registration.devices.camera_frame.insert import (
    Insert,
    design_insert,
    insert_solids,
    read_insert,
    write_dots,
    write_files,
    write_insert,
    write_svg,
)
from registration.devices.camera_frame.marks import SeenMarks, find_marks
from registration.devices.camera_frame.printed_lines import PrintedLine, find_crossings
from registration.devices.camera_frame.tip import SeenTip, find_tip
from registration.devices.camera_frame.tip_place import (
    Tip,
    TipView,
    find_tips,
    grounds,
    locate_tip,
)

__all__ = [
    "Bath",
    "CameraFrame",
    "FrameCheck",
    "Insert",
    "PrintedLine",
    "PrintedPoints",
    "SeenMarks",
    "SeenTip",
    "Ties",
    "Tip",
    "TipView",
    "Touch",
    "check_frame",
    "design_insert",
    "find_crossings",
    "find_marks",
    "find_tip",
    "find_tips",
    "fit_frame",
    "fit_printed_frame",
    "frame_notes",
    "grounds",
    "insert_solids",
    "locate_tip",
    "merged",
    "read_frame",
    "read_insert",
    "write_dots",
    "write_files",
    "write_insert",
    "write_svg",
]
