"""Write the HTML and PDF pages of `printctl register`; called in a second process.

Apart from what registers, which needs no plotting library.
"""

from __future__ import annotations

from pathlib import Path

from printctl.pipeline.judging.look_rows import look_rows
from printctl.pipeline.judging.page_parts import PageParts
from printctl.run_folder.artefacts import HTML, NUMBERS, PDF
from report import all_figures, network_drawing, write_report_html
from report.figures.look_figure import look_figures
from report.print_page import print_page

__all__ = ["all_figures", "network_drawing", "write_pages"]


def write_pages(folder: Path, parts: PageParts) -> None:
    """Write the HTML page, and the PDF where it is asked for, into a folder."""
    drawn = parts.drawn | (
        {} if parts.observed is None else look_figures(look_rows(parts.observed))
    )
    shown = {**parts.data, "numbers_file": NUMBERS, "strahler_orders": parts.orders}
    if parts.origin is not None:
        shown["provenance"] = parts.origin
    write_report_html(folder / HTML, shown, parts.surfaces, parts.network, drawn, views=parts.views)
    if parts.origin is not None:
        print_page(folder / HTML, folder / PDF)
