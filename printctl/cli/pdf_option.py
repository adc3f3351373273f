"""Command-line option ``--pdf``, refused where no browser is installed that prints."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.errors import UsageError


def _checked(wanted: bool) -> bool:
    if wanted:
        from registration.report.print_page import browser_missing  # Only wanted here.

        missing = browser_missing()
        if missing is not None:
            raise UsageError(f"--pdf: {missing}")
    return wanted


PdfFlag = Annotated[
    bool,
    typer.Option(
        "--pdf",
        help="Print the page to a PDF too, by an installed Chromium, Chrome or Edge.",
        # Before the work starts.
        callback=_checked,
    ),
]
