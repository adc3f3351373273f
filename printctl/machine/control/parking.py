"""Move the needle to a park position beside the dish for an inspection, and back above the job."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from printctl.machine.control.channel import Channel
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.inserting import Inserting
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.coordinates import Modal

ABOVE_MM: Final = 5.0
"""Kept above the job's greatest height on the way across."""
ACROSS_MM_S: Final = 20.0

Park = tuple[float, float, float]


def refuse_park(park: Park | None, printer: Printer) -> None:
    """Refuse a place that the machine doesn't reach.

    Raises
    ------
    Refused
    """
    for axis, mm in zip("xyz", park or (), strict=False):
        span = getattr(printer, f"{axis}_mm")
        if not span.low <= mm <= span.high:
            raise Refused(
                f"park_mm: {axis.upper()} {mm:g} mm is outside {span.low:g} to {span.high:g} "
                f"mm ({axis}_mm of {printer.name}); give a place within"
            )


@dataclass(frozen=True)
class Parking:
    """Goes up first, then across above all that the job writes, then to the place's height.

    Attributes
    ----------
    channel : Channel
    heads : HeadChoice
    position : PositionCheck
    inserting : Inserting
        Knows how high the job goes.
    """

    channel: Channel
    heads: HeadChoice
    position: PositionCheck
    inserting: Inserting

    def place(self, park: Park | None) -> Park | None:
        """Return where ``park`` is as the job counts here; None for straight above.

        None as well where nobody can tell how the job counts, or where the needle would come down
        into the part: an alarm says so.
        """
        if park is None:
            return None
        at = self.channel.logbook.progress.modal()
        try:
            x, y, z = self.inserting.shift_mm()
            reach = self.inserting.reach
        except LinkError as exc:
            self._not_parked(str(exc))
            return None
        if park[2] < reach.top_mm and reach.is_inside(*park):
            self._not_parked(f"{park} mm is within what the job writes; give a place beside it")
            return None
        if at.x is None or at.y is None or at.z is None:
            self._not_parked("the job's text doesn't say where the needle stands")
            return None
        return park[0] + x, park[1] + y, park[2] + z

    def _not_parked(self, why: str) -> None:
        self.channel.logbook.alarm(
            f"the needle isn't led to park_mm, it waits straight above: {why}"
        )

    def go(self, at: Modal, park: Park) -> None:
        """Lead the needle, which was lifted above ``at``, to ``park``; each step is waited for."""
        high = self._height(at, park)
        self._step(_height(high), self._up_mm_s)
        self._across(park[0], park[1])
        self._step(_height(park[2]), self._up_mm_s)

    def come(self, at: Modal, park: Park) -> None:
        """Lead it back above ``at``, as high as it went across."""
        self._step(_height(self._height(at, park)), self._up_mm_s)
        self._across(at.x or 0.0, at.y or 0.0)

    def is_there(self, at: Modal, park: Park) -> bool:
        """Whether the printer says that it stands at the parking place, and not above ``at``."""
        if at.x is None or at.y is None or at.z is None:
            return False
        wrong, _ = self.position.compare(Modal(x=park[0], y=park[1]))
        return (at.x, at.y) != park[:2] and not wrong

    @property
    def _up_mm_s(self) -> float:
        printer = self.channel.wiring.printer
        return min(self.heads.retreat.lift_mm_s, printer.max_speed_mm_s.z)

    def _height(self, at: Modal, park: Park) -> float:
        """Height of the way across, mm: above job and parking place, within the axis."""
        shift, z = self.inserting.shift_mm()[2], at.z or 0.0
        lifted = z + self.heads.retreat.lift_mm
        wanted = max(lifted, self.inserting.reach.top_mm + shift + ABOVE_MM, park[2])
        return max(z, min(wanted, self.channel.wiring.printer.z_mm.high + shift))

    def _across(self, x_mm: float, y_mm: float) -> None:
        speed = self.channel.wiring.printer.max_speed_mm_s
        self._step(b"X%.5f Y%.5f" % (x_mm, y_mm), min(ACROSS_MM_S, speed.x, speed.y))

    def _step(self, place: bytes, speed_mm_s: float) -> None:
        self.channel.command(b"G1 %b F%.0f" % (place, speed_mm_s * 60))
        self.channel.command(b"M400")


def _height(z_mm: float) -> bytes:
    return b"Z%.5f" % z_mm
