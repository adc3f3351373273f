"""Command-line option ``--pdf``, refused if reportlab isn't installed."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.errors import UsageError


def _checked(wanted: bool) -> bool:
    if wanted:
        from registration.report.pdf import pdf_missing  # Loads what draws; only wanted here.

        missing = pdf_missing()
        if missing is not None:
            raise UsageError(f"--pdf: {missing}")
    return wanted


PdfFlag = Annotated[
    bool,
    typer.Option(
        "--pdf",
        help="Write the page as a PDF too (pip install 'printctl[pdf]').",
        # Before the work starts.
        callback=_checked,
    ),
]
