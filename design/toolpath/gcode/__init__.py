"""G-code: a writer per firmware behind one door."""

from design.toolpath.gcode.job import Gcode, GcodeOptions
from design.toolpath.gcode.write import write_gcode

__all__ = ["Gcode", "GcodeOptions", "write_gcode"]
