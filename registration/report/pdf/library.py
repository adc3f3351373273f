"""Write report and comparison PDFs; import reportlab only on call, and report its absence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from design.files import write_bytes
from design.network import VesselNetwork
from registration.report.errors import ReportError

if TYPE_CHECKING:  # statistics are slow to load, and only a comparison needs them
    from registration.comparison import Comparison
    from registration.report.comparison import Drawn
    from registration.report.views import Views

_LIBRARY = "reportlab"


def pdf_missing() -> str | None:
    """Return the remedy where the library isn't installed; None where it is."""
    if find_spec(_LIBRARY) is not None:
        return None
    return f"a PDF needs {_LIBRARY}, which isn't installed; run: pip install 'printctl[pdf]'"


def write_report_pdf(
    path: Path,
    data: Mapping[str, Any],
    network: VesselNetwork | None = None,
    figures: Mapping[str, bytes] | None = None,
    views: Views | None = None,
) -> None:
    """Write report.json's dict as a PDF; same input, same bytes.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    data : dict
        As `registration.report.write_report_html` takes it; whatever of it is missing is left
        out. Of clocks it shows ``printed.started`` alone.
    network : VesselNetwork or None
        For the drawings of the design.
    figures : dict of "section/caption" to SVG or PNG, or None
        As `registration.report.write_report_html` takes them.
    views : Views or None
        Raw pictures of findings.

    Raises
    ------
    ReportError
        When reportlab isn't installed, or a figure is neither SVG nor PNG.
    OSError
        When the file can't be written.
    """
    _need()
    from registration.report.pdf.report import report_pdf  # reportlab is an extra

    write_bytes(path, report_pdf(data, network, figures or {}, views))


def write_comparison_pdf(
    path: Path,
    comparison: Comparison,
    title: str,
    notes: Sequence[str] = (),
    drawn: Drawn | None = None,
) -> None:
    """Write a comparison of prints as a PDF; the parameters are the page's.

    Raises
    ------
    ReportError
        When reportlab isn't installed.
    OSError
        When the file can't be written.
    """
    _need()
    from registration.report.pdf.comparison import comparison_pdf  # reportlab is an extra

    write_bytes(path, comparison_pdf(comparison, title, notes, drawn))


def _need() -> None:
    missing = pdf_missing()
    if missing is not None:
        raise ReportError(missing)
