"""G-code of any origin as a job to look at: layers, widths, kinds of lines."""

from printctl.gcode_view.doses import Pushing
from printctl.gcode_view.line_map import LineMap, read_line_map
from printctl.gcode_view.read import Reading, read_job, read_with_program

__all__ = ["LineMap", "Pushing", "Reading", "read_job", "read_line_map", "read_with_program"]
