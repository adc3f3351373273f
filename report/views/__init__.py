"""Raw pictures from a scan for the report: B-scans and sections with designed and found contours.

Names are loaded when first asked for.

Goes in: a scan and its judged registration. Comes out: pictures with contours. Begin with
`take_pictures.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from report.views.file import load_views, save_views
    from report.views.findings import FindingView
    from report.views.stack import SectionStack
    from report.views.take_pictures import Views, add_scan_places, take_views

__all__ = [
    "FindingView",
    "SectionStack",
    "Views",
    "add_scan_places",
    "load_views",
    "save_views",
    "take_views",
]

__getattr__, __dir__ = on_demand(__name__)
