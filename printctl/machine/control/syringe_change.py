"""State of a syringe change during a print: pending or not, and the head concerned."""

from __future__ import annotations

from typing import Final

from printctl.machine.control.progress import JobProgress
from printctl.machine.control.wiring import Wiring
from printctl.machine.job.syringes import Filling

CHANGE: Final = (
    "change the syringe and prime it to the needle's tip, then `printctl resume RUN --plunger-mm "
    "USED` (0 for a full one) or `--syringe PROFILE`; `--unchanged` if you didn't"
)


class SyringeChange:
    """Read by any thread, written by the one that speaks to the printer.

    Parameters
    ----------
    wiring : Wiring
    progress : JobProgress

    Attributes
    ----------
    going_on : bool
    begun : int
        Changes that were begun so far.
    planned_head : int or None
        Whose syringe it is, where that was said.
    filled : dict of (int or None) to Filling
        What was put in in this print, by head; None for the only one.
    """

    def __init__(self, wiring: Wiring, progress: JobProgress) -> None:
        self._printer, self._progress = wiring.printer, progress
        self.going_on = False
        self.begun = 0
        self.planned_head: int | None = None
        self.filled: dict[int | None, Filling] = {}

    @property
    def head(self) -> int | None:
        """Whose syringe is changed; None where there is one head."""
        return self._progress.head if self.planned_head is None else self.planned_head

    @property
    def idle_head(self) -> int | None:
        """The head that is changed where that is another than the one in use; else None."""
        planned, used = self.planned_head, self._progress.head
        return planned if used is not None and planned != used else None

    def plan(self, head: int | None) -> None:
        """Say whose syringe is changed next."""
        self.planned_head = head

    def begin(self) -> None:
        """Take notice that the plunger's count is about to lose its meaning."""
        self.going_on = True
        self.begun += 1

    def end(self) -> None:
        """Take notice that the print goes on."""
        self.going_on, self.planned_head = False, None

    def words(self) -> str:
        """Return what a person is to do."""
        number = self.head
        if number is None:
            return CHANGE
        return f"head {number} ({self._printer.heads[number].name}): {CHANGE}"
