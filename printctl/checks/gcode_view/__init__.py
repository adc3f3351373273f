"""Read any G-code file for display: moves by layer, with line widths, ink volumes and types.

Goes in: a G-code file. Comes out: its moves by layer, with widths and types. Begin with `read.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.checks.gcode_view.line_map import LineMap, read_line_map
    from printctl.checks.gcode_view.pushing import Pushing
    from printctl.checks.gcode_view.read import Reading, read_job, read_with_program

__all__ = ["LineMap", "Pushing", "Reading", "read_job", "read_line_map", "read_with_program"]

__getattr__, __dir__ = on_demand(__name__)
