"""Track a needle moved by the link, not the job; on a stop, relieve the plunger and lift it."""

from __future__ import annotations

from typing import Final

from firmware_profiles import Printer
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.retreat import Retreat, count_from

TOLD_MM: Final = 0.0051
"""Half of the last digit in which M114 tells a position."""


class Excursion:
    """What is known between leaving the job's place and being back, for a stop in between.

    Attributes
    ----------
    going_on : bool
    """

    def __init__(self) -> None:
        self.going_on = self._rests = False
        self._counted = True
        self._left = Modal()
        self._relieved_mm = 0.0
        self._top: float | None = None

    def begin(self, left: Modal, relieved_mm: float, top: float | None) -> None:
        """Take notice that the needle leaves.

        Parameters
        ----------
        left : Modal
            The job's place.
        relieved_mm : float, mm
            How far the job itself had drawn the plunger back there.
        top : float or None, mm
            Greatest height that the needle comes to.
        """
        self.going_on, self._rests, self._counted = True, False, True
        self._left, self._relieved_mm, self._top = left, relieved_mm, top

    def rest(self) -> None:
        """Take notice that needle and plunger are a person's: a stop leaves both where they are."""
        self._rests = True

    def lose_count(self) -> None:
        """Take notice that the plunger's count says nothing: its syringe is changed."""
        self._counted = False

    def come_back(self, top: float) -> None:
        """Take notice that the needle comes down from ``top``, mm, the plunger counted again."""
        self._rests, self._counted, self._top = False, True, top

    def end(self) -> None:
        """Take notice that needle and plunger are where the job had them."""
        self.going_on = False

    def words(self) -> str:
        """Return when a stop came, for its message; empty for a place of the job's."""
        if not self.going_on:
            return ""
        return " while paused" if self._rests else " while the link moved the needle"

    def plunger_e(self, retreat: Retreat) -> float | None:
        """Return what the plunger's count was left at, mm; None where only a person may know."""
        if not self.going_on or not self._counted or self._top is None or self._left.e is None:
            return None
        return retreat.relieved_e(self._left.e, self._relieved_mm)

    def way_out(self, now: Modal, retreat: Retreat, printer: Printer) -> list[bytes]:
        """Commands that relieve the plunger as a pause does, and lift the needle as high.

        The plunger is never pushed, the needle never lowered.

        Parameters
        ----------
        now : Modal
            Where the printer says that it stands; empty where that can't be read.
        retreat : Retreat
        printer : Printer
        """
        if self._rests:
            return []
        return self._relieve(now.e, retreat, printer) + self._lift(now.z, retreat, printer)

    def _relieve(self, e: float | None, retreat: Retreat, printer: Printer) -> list[bytes]:
        if e is None or self._left.e is None or printer.pneumatic or not self._counted:
            return []
        if e > self._left.e + TOLD_MM:  # primed
            return [count_from(e), retreat.relieve_to(retreat.relieved_e(e), printer)]
        relieved = retreat.relieved_e(self._left.e, self._relieved_mm)
        return [retreat.relieve_to(relieved, printer)] if e > relieved - TOLD_MM else []

    def _lift(self, z: float | None, retreat: Retreat, printer: Printer) -> list[bytes]:
        left = self._left
        if left.z is None:
            return []
        if z is None:
            return [] if self._top is None else retreat.rise(left, printer, self._top - left.z)
        return retreat.rise(Modal(z=z), printer, left.z + retreat.lift_mm - z)
