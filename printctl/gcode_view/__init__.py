"""G-code of any origin as a job to look at: layers, widths, kinds of lines."""

from printctl.gcode_view.doses import Pushing
from printctl.gcode_view.line_map import LineMap, read_line_map
from printctl.gcode_view.read import read_job

__all__ = ["LineMap", "Pushing", "read_job", "read_line_map"]
