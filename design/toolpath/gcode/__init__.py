"""Write a toolpath as G-code in the dialect of the printer's firmware.

Goes in: a toolpath, a printer, a syringe. Comes out: G-code with the map of its lines. Begin with
`write.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.toolpath.gcode.commands import clear_mm, joint_mm, least_move_mm
    from design.toolpath.gcode.job import Gcode, GcodeOptions, HeadLoad
    from design.toolpath.gcode.marks import add_labels
    from design.toolpath.gcode.write import save_gcode, stream_gcode, write_gcode

__all__ = [
    "Gcode",
    "GcodeOptions",
    "HeadLoad",
    "add_labels",
    "clear_mm",
    "joint_mm",
    "least_move_mm",
    "save_gcode",
    "stream_gcode",
    "write_gcode",
]

__getattr__, __dir__ = on_demand(__name__)
