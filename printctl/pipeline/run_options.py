"""Options of a recipe's run: last stage, PDF report, print confirmation, progress listener."""

from __future__ import annotations

from dataclasses import dataclass

from printctl.progress import Listener


@dataclass(frozen=True)
class RunOptions:
    """RunOptions a recipe is run.

    Attributes
    ----------
    assume_yes : bool
        Don't ask before a print on a real printer.
    pdf : bool
        Write the report as a PDF too.
    until : str or None
        The last stage, by its name; all of them and the report without.
    printed : bool
        Take the print that is done in the run's folder; nothing is printed.
    listener : Listener or None
        Told of progress.
    """

    assume_yes: bool = False
    pdf: bool = False
    until: str | None = None
    printed: bool = False
    listener: Listener | None = None
