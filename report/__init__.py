"""Offline HTML and PDF reports of registrations, with pages for dye, plates, G-code and networks.

Names are loaded when first asked for: what packs or words a report needs no plotting library.

Goes in: report.json's numbers and surfaces. Comes out: HTML. Begin with `pages/registration.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from report.errors import ReportError
    from report.figures.deviation import (
        diameter_figure,
        histogram_figure,
        network_figure,
    )
    from report.figures.report_figures import all_figures, network_drawing
    from report.pages.network import (
        NetworkPage,
        write_network_html,
        write_places_html,
    )
    from report.pages.registration import write_report_html
    from report.pages.standalone import write_report
    from report.surface import ReportSurface

__all__ = [
    "NetworkPage",
    "ReportError",
    "ReportSurface",
    "all_figures",
    "diameter_figure",
    "histogram_figure",
    "network_drawing",
    "network_figure",
    "write_network_html",
    "write_places_html",
    "write_report",
    "write_report_html",
]

__getattr__, __dir__ = on_demand(__name__)
