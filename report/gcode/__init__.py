"""Show a G-code job: an offline HTML page of all layers, and a picture (PNG, SVG) of one.

Goes in: a G-code job's moves. Comes out: HTML, or a picture. Begin with `page.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from registration.gcode_job import Act, GcodeJob, Layers, layer_sums
    from report.gcode.figure import draw_layer, layer_figure
    from report.gcode.page import GcodePage, write_gcode_html
    from report.gcode.part_outline import DesignOutline, design_outline

__all__ = [
    "Act",
    "DesignOutline",
    "GcodeJob",
    "GcodePage",
    "Layers",
    "design_outline",
    "draw_layer",
    "layer_figure",
    "layer_sums",
    "write_gcode_html",
]

__getattr__, __dir__ = on_demand(__name__)
