"""State of a held print: needle and plunger away from the job's place, syringe being changed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from firmware_profiles import Printer
from printctl.machine.control.board.progress import JobProgress
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.retreat import Retreat, count_from
from printctl.machine.job.syringes import Filling

M114_ROUNDING_MM: Final = 0.0051
"""Half of the last digit of M114's positions."""
CHANGE: Final = (
    "change the syringe and prime it to the needle tip, then `printctl resume RUN --plunger-mm "
    "USED` (0 for a full one) or `--syringe PROFILE`; `--unchanged` if it wasn't changed"
)


@dataclass
class Excursion:
    """Way between leaving the job's place and being back, for a stop in between."""

    going_on: bool = False
    left: Modal = field(default_factory=Modal)  # the job's place
    relieved_mm: float = 0.0  # how far the job itself had drawn the plunger back there
    top: float | None = None  # mm: greatest height that the needle comes to
    clear_mm: float | None = None  # first height read in the pause, above which nothing stands
    counted: bool = True  # the plunger's count means something: no syringe is being changed
    rests: bool = False  # needle and plunger are a person's: a stop leaves both where they are

    def come_back(self, top: float) -> None:
        """Record that the needle comes down from ``top``, mm, the plunger counted again."""
        self.rests, self.counted, self.top = False, True, top

    def words(self) -> str:
        """Return when a stop came, for its message; empty for a place of the job's."""
        if not self.going_on:
            return ""
        return " while paused" if self.rests else " while the link moved the needle"

    def plunger_e(self, retreat: Retreat) -> float | None:
        """Return what the plunger's count was left at, mm; None where only a person may know."""
        if not self.going_on or not self.counted or self.top is None or self.left.e is None:
            return None
        return retreat.relieved_e(self.left.e, self.relieved_mm)

    def way_out(self, now: Modal, retreat: Retreat, printer: Printer) -> list[bytes]:
        """Commands that relieve the plunger as a pause does, and lift the needle as high.

        The plunger is never pushed, the needle never lowered. ``now``: where the printer says that
        it stands; empty where that can't be read.
        """
        if self.rests:
            return []
        left, e, way = self.left, now.e, list[bytes]()
        if e is not None and left.e is not None and self.counted and not printer.pneumatic:
            relieved = retreat.relieved_e(left.e, self.relieved_mm)
            if e > left.e + M114_ROUNDING_MM:  # primed
                way = [count_from(e), retreat.relieve_to(retreat.relieved_e(e), printer)]
            elif e > relieved - M114_ROUNDING_MM:
                way = [retreat.relieve_to(relieved, printer)]
        if left.z is None:
            return way
        if now.z is not None:
            lift = left.z + retreat.lift_mm - now.z
            return way + retreat.rise(Modal(z=now.z), printer, lift)
        return way if self.top is None else way + retreat.rise(left, printer, self.top - left.z)


@dataclass
class SyringeChange:
    """Syringes of one print; read by any thread, written by the one that speaks to the printer."""

    progress: JobProgress
    going_on: bool = False
    begun: int = 0  # changes so far
    planned_head: int | None = None  # whose syringe is changed, where that is known
    # what was put in in this print, by head; None for the only one
    filled: dict[int | None, Filling] = field(default_factory=dict)
    wanted_head: int | None = None  # whose syringe a client wants changed; any thread may set it

    @property
    def head(self) -> int | None:
        """Whose syringe is changed; None where there is one head."""
        return self.progress.head if self.planned_head is None else self.planned_head

    @property
    def idle_head(self) -> int | None:
        """The head that is changed where that is another than the one in use; else None."""
        planned, used = self.planned_head, self.progress.head
        return planned if used is not None and planned != used else None

    def words(self, printer: Printer) -> str:
        """Return what a person is to do."""
        number = self.head
        return (
            CHANGE if number is None else f"head {number} ({printer.heads[number].name}): {CHANGE}"
        )
