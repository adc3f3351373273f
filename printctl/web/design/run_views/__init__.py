"""Views of a run for the Design page: key figures, network, layers, comparison of two runs.

Goes in: a run folder. Comes out: key figures and pages, cached. Begin with `views.py`.
"""

from printctl.web.design.run_views.compare import Comparison, compare_runs
from printctl.web.design.run_views.figures import Figure, key_figures
from printctl.web.design.run_views.views import gcode_page, network_page, tissue_page

__all__ = [
    "Comparison",
    "Figure",
    "compare_runs",
    "gcode_page",
    "key_figures",
    "network_page",
    "tissue_page",
]
